//! A file that can be read after every write, whatever happens to the program.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;

/// DataEnd, Footer and magic of an MCAP file without summary section: what makes the bytes before it a whole file.
const TAIL: [u8; 50] = tail();

const OP_FOOTER: u8 = 0x02;
const OP_DATA_END: u8 = 0x0f;
const DATA_END_BYTES: u8 = 4; // data section CRC, 0: not computed
const FOOTER_BYTES: u8 = 20; // summary start, summary offset start, summary CRC; 0: none

const fn tail() -> [u8; 50] {
    let mut bytes = [0; 50];
    bytes[0] = OP_DATA_END;
    bytes[1] = DATA_END_BYTES;
    bytes[13] = OP_FOOTER;
    bytes[14] = FOOTER_BYTES;
    let mut i = 0;
    while i < mcap::MAGIC.len() {
        bytes[42 + i] = mcap::MAGIC[i];
        i += 1;
    }
    bytes
}

/// Collects what is written and hands it to the kernel on `flush`, together with a tail that the next flush overwrites,
/// in one call: the file on disk is a whole MCAP file at any time after the first flush.
pub struct CrashSafeFile {
    file: File,
    written: u64,
    pending: Vec<u8>,
}

impl CrashSafeFile {
    pub fn new(file: File) -> Self {
        Self {
            file,
            written: 0,
            pending: Vec::new(),
        }
    }

    /// Writes the rest without a tail: the caller has written its own end of file.
    pub fn finish(self) -> io::Result<()> {
        self.file.write_all_at(&self.pending, self.written)?;
        self.file.set_len(self.written + self.pending.len() as u64)
    }
}

impl Write for CrashSafeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.pending.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        let n = self.pending.len();
        self.pending.extend_from_slice(&TAIL);
        let result = self.file.write_all_at(&self.pending, self.written);
        self.pending.truncate(n);
        result?;
        self.written += n as u64;
        self.pending.clear();
        Ok(())
    }
}

impl Seek for CrashSafeFile {
    /// Tells the position; the writer runs with seeking disabled and asks for nothing else.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.written + self.pending.len() as u64),
            _ => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}
