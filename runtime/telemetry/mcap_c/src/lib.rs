//! The part of the `mcap` crate that the runtime needs, behind a C interface. Contracts stand in mcap_c.h.

mod crash_safe_file;

use std::{
    borrow::Cow,
    collections::BTreeMap,
    ffi::{c_char, CStr},
    path::Path,
    slice,
};

use crash_safe_file::CrashSafeFile;
use mcap::{
    records::{MessageHeader, Metadata},
    Attachment, Compression, McapError, WriteOptions, Writer,
};

pub struct McapWriter {
    writer: Writer<CrashSafeFile>,
    error: String,
}

const FAILED: i32 = -1;

/// The operating system's words where there are some: mcap's own sentence for them does not say what happened.
fn explain(error: &McapError) -> String {
    match error {
        McapError::Io(e) => e.to_string(),
        e => e.to_string(),
    }
}

impl McapWriter {
    fn note<T>(&mut self, result: Result<T, McapError>) -> Option<T> {
        result.map_err(|e| self.error = explain(&e)).ok()
    }
}

/// # Safety
/// `text` is NULL or a string that ends in zero.
unsafe fn text<'a>(text: *const c_char) -> &'a str {
    if text.is_null() {
        return "";
    }
    CStr::from_ptr(text).to_str().unwrap_or("")
}

/// # Safety
/// `data` points to `n` bytes, or `n` is 0.
unsafe fn bytes<'a>(data: *const u8, n: usize) -> &'a [u8] {
    if n == 0 {
        return &[];
    }
    slice::from_raw_parts(data, n)
}

/// # Safety
/// `to` has room for `size` bytes.
unsafe fn copy_text(from: &str, to: *mut c_char, size: usize) {
    if size == 0 {
        return;
    }
    let n = from.len().min(size - 1);
    std::ptr::copy_nonoverlapping(from.as_ptr(), to.cast::<u8>(), n);
    *to.add(n) = 0;
}

fn open(path: &str, profile: &str, library: &str, chunk_bytes: u64) -> Result<McapWriter, McapError> {
    let mut writer = WriteOptions::new()
        .profile(profile)
        .library(library)
        .compression(Some(Compression::Lz4))
        .chunk_size(Some(chunk_bytes))
        .disable_seeking(true) // a chunk is written whole or not at all
        .create(CrashSafeFile::create(Path::new(path))?)?;
    writer.flush()?;
    Ok(McapWriter {
        writer,
        error: String::new(),
    })
}

/// # Safety
/// See mcap_c.h.
#[no_mangle]
pub unsafe extern "C" fn mcap_c_open(
    path: *const c_char,
    profile: *const c_char,
    library: *const c_char,
    chunk_bytes: u64,
    error: *mut c_char,
    error_size: usize,
) -> *mut McapWriter {
    match open(text(path), text(profile), text(library), chunk_bytes) {
        Ok(writer) => Box::into_raw(Box::new(writer)),
        Err(e) => {
            copy_text(&explain(&e), error, error_size);
            std::ptr::null_mut()
        }
    }
}

/// # Safety
/// See mcap_c.h.
#[no_mangle]
pub unsafe extern "C" fn mcap_c_add_schema(
    writer: *mut McapWriter,
    name: *const c_char,
    encoding: *const c_char,
    data: *const u8,
    n: usize,
) -> i32 {
    let w = &mut *writer;
    let result = w.writer.add_schema(text(name), text(encoding), bytes(data, n));
    w.note(result).map_or(FAILED, i32::from)
}

/// # Safety
/// See mcap_c.h.
#[no_mangle]
pub unsafe extern "C" fn mcap_c_add_channel(
    writer: *mut McapWriter,
    schema: u16,
    topic: *const c_char,
    encoding: *const c_char,
) -> i32 {
    let w = &mut *writer;
    let result = w
        .writer
        .add_channel(schema, text(topic), text(encoding), &BTreeMap::new());
    w.note(result).map_or(FAILED, i32::from)
}

/// # Safety
/// See mcap_c.h.
#[no_mangle]
pub unsafe extern "C" fn mcap_c_write(
    writer: *mut McapWriter,
    channel: u16,
    sequence: u32,
    log_time_ns: u64,
    data: *const u8,
    n: usize,
) -> i32 {
    let w = &mut *writer;
    let header = MessageHeader {
        channel_id: channel,
        sequence,
        log_time: log_time_ns,
        publish_time: log_time_ns,
    };
    let result = w.writer.write_to_known_channel(&header, bytes(data, n));
    w.note(result).map_or(FAILED, |()| 0)
}

/// # Safety
/// See mcap_c.h.
#[no_mangle]
pub unsafe extern "C" fn mcap_c_write_metadata(
    writer: *mut McapWriter,
    name: *const c_char,
    keys: *const *const c_char,
    values: *const *const c_char,
    n: usize,
) -> i32 {
    let w = &mut *writer;
    let metadata = (0..n)
        .map(|i| (text(*keys.add(i)).to_owned(), text(*values.add(i)).to_owned()))
        .collect();
    let result = w.writer.write_metadata(&Metadata {
        name: text(name).to_owned(),
        metadata,
    });
    w.note(result).map_or(FAILED, |()| 0)
}

/// # Safety
/// See mcap_c.h.
#[no_mangle]
pub unsafe extern "C" fn mcap_c_attach(
    writer: *mut McapWriter,
    name: *const c_char,
    media_type: *const c_char,
    data: *const u8,
    n: usize,
) -> i32 {
    let w = &mut *writer;
    let result = w.writer.attach(&Attachment {
        log_time: 0,
        create_time: 0,
        name: text(name).to_owned(),
        media_type: text(media_type).to_owned(),
        data: Cow::Borrowed(bytes(data, n)),
    });
    w.note(result).map_or(FAILED, |()| 0)
}

/// # Safety
/// See mcap_c.h.
#[no_mangle]
pub unsafe extern "C" fn mcap_c_flush(writer: *mut McapWriter) -> i32 {
    let w = &mut *writer;
    let result = w.writer.flush();
    w.note(result).map_or(FAILED, |()| 0)
}

/// # Safety
/// See mcap_c.h.
#[no_mangle]
pub unsafe extern "C" fn mcap_c_error(writer: *const McapWriter, error: *mut c_char, error_size: usize) {
    copy_text(&(*writer).error, error, error_size);
}

/// # Safety
/// See mcap_c.h.
#[no_mangle]
pub unsafe extern "C" fn mcap_c_close(writer: *mut McapWriter, error: *mut c_char, error_size: usize) -> i32 {
    let mut w = Box::from_raw(writer);
    let result = w.writer.flush().and_then(|()| w.writer.finish());
    drop(w.writer.into_inner()); // without another try where one failed
    match result {
        Ok(_) => 0,
        Err(e) => {
            copy_text(&explain(&e), error, error_size);
            FAILED
        }
    }
}
