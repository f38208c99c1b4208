//! A file that can be read after every write, whatever happens to the program or the machine.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::records::op;

/// Opcode and length before every record.
const FRAME_BYTES: usize = 1 + 8;
/// A record that readers skip: the MCAP specification leaves opcodes from 0x80 on to applications.
const FILLER: u8 = 0x80;
/// By this much the file runs ahead of what is in it, in a hole that takes no space on the disk.
const AHEAD_BYTES: u64 = 1 << 20;
/// An end of file without a summary: DataEnd, Footer, magic.
const END: [u8; 50] = *b"\x0f\x04\0\0\0\0\0\0\0\0\0\0\0\
    \x02\x14\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\
    \x89MCAP0\r\n";

/// Collects what is written and puts it into the file on `flush`, so that the file is a whole MCAP file at any time:
///
/// ```text
/// records … | filler (a hole) | DataEnd, Footer, magic
/// ```
///
/// New records are written into the hole, all but their first FRAME_BYTES, with the frame of the shorter filler behind
/// them; when they are on the disk, those first bytes replace the frame of the filler there was. So a flush writes what
/// is new and a few bytes, however long the file has become. DataEnd and what follows it are put there likewise, and the
/// rest is cut off.
pub struct CrashSafeFile {
    file: File,
    /// Bytes of records in the file.
    written: u64,
    /// Length of the file.
    length: u64,
    pending: Vec<u8>,
}

impl CrashSafeFile {
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = File::create(path)?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        File::open(folder.unwrap_or(Path::new(".")))?.sync_all()?; // the file's name
        Ok(Self {
            file,
            written: 0,
            length: 0,
            pending: Vec::new(),
        })
    }

    fn filler_frame(&self, at: u64) -> [u8; FRAME_BYTES] {
        let mut frame = [FILLER; FRAME_BYTES];
        let body = self.length - END.len() as u64 - at - FRAME_BYTES as u64;
        frame[1..].copy_from_slice(&body.to_le_bytes());
        frame
    }

    /// Moves the end of the file so that `records_end` and a filler fit before it.
    fn make_space(&mut self, records_end: u64) -> io::Result<()> {
        let needed = records_end + (FRAME_BYTES + END.len()) as u64;
        if needed <= self.length {
            return Ok(());
        }
        let length = needed + AHEAD_BYTES;
        self.file.write_all_at(&END, length - END.len() as u64)?;
        self.length = length;
        self.file.write_all_at(&self.filler_frame(self.written), self.written)
    }

    fn put(&mut self) -> io::Result<()> {
        let is_end = self.pending[0] == op::DATA_END;
        let records_end = self.written + self.pending.len() as u64;
        self.make_space(records_end)?;
        let mut body = self.pending[FRAME_BYTES..].to_vec();
        if !is_end {
            body.extend_from_slice(&self.filler_frame(records_end));
        }
        self.file.write_all_at(&body, self.written + FRAME_BYTES as u64)?;
        self.file.sync_data()?;
        if is_end {
            self.file.set_len(records_end)?; // the summary tells where the records are, whatever stands before it
        }
        self.file.write_all_at(&self.pending[..FRAME_BYTES], self.written)?;
        if is_end {
            self.file.sync_data()?;
        }
        self.pending.clear();
        self.written = records_end;
        Ok(())
    }
}

impl Write for CrashSafeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.pending.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    /// To be called between records only, and before DataEnd.
    fn flush(&mut self) -> io::Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        self.put()
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
