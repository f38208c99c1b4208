//! A file that can be read after every write, whatever happens to the program.

use std::cell::RefCell;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::rc::Rc;

use crate::summary::Summary;

/// Collects what is written and hands it to the kernel on `flush`, together with an end of file that the next flush
/// overwrites, in one call: the file on disk is a whole MCAP file at any time after the first flush.
pub struct CrashSafeFile {
    file: File,
    written: u64,
    pending: Vec<u8>,
    summary: Rc<RefCell<Summary>>,
}

impl CrashSafeFile {
    /// `summary` learns of the records as they pass; whoever writes tells it of schemas and channels.
    pub fn new(file: File, summary: Rc<RefCell<Summary>>) -> Self {
        Self {
            file,
            written: 0,
            pending: Vec::new(),
            summary,
        }
    }
}

impl Write for CrashSafeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.pending.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    /// To be called between records only.
    fn flush(&mut self) -> io::Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        let magic = if self.written == 0 { mcap::MAGIC.len() } else { 0 };
        let mut summary = self.summary.borrow_mut();
        summary
            .scan(&self.pending[magic..], self.written + magic as u64)
            .map_err(io::Error::other)?;
        let data_end = self.written + self.pending.len() as u64;
        self.pending.extend_from_slice(&summary.end_of_file(data_end)?);
        self.file.write_all_at(&self.pending, self.written)?;
        self.pending.clear();
        self.written = data_end;
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
