//! The end of an MCAP file: what its chunks hold and where they lie, written anew whenever the file has grown.

use std::io::{self, Cursor};

use binrw::BinWrite;
use mcap::{
    parse_record,
    records::{op, Channel, ChunkIndex, DataEnd, Footer, MetadataIndex, Record, SchemaHeader, Statistics},
    McapError,
};

const OP_BYTES: usize = 1;
const FRAME_BYTES: usize = OP_BYTES + 8; // opcode and length before every record

#[derive(Default)]
pub struct Summary {
    schemas: Vec<(SchemaHeader, Vec<u8>)>,
    channels: Vec<Channel>,
    statistics: Statistics,
    chunks: Vec<ChunkIndex>,
    metadata: Vec<MetadataIndex>,
}

impl Summary {
    pub fn add_schema(&mut self, id: u16, name: &str, encoding: &str, data: &[u8]) {
        let header = SchemaHeader {
            id,
            name: name.to_owned(),
            encoding: encoding.to_owned(),
        };
        self.schemas.push((header, data.to_owned()));
        self.statistics.schema_count += 1;
    }

    pub fn add_channel(&mut self, id: u16, schema_id: u16, topic: &str, message_encoding: &str) {
        self.channels.push(Channel {
            id,
            schema_id,
            topic: topic.to_owned(),
            message_encoding: message_encoding.to_owned(),
            metadata: Default::default(),
        });
        self.statistics.channel_count += 1;
    }

    /// Takes note of whole records that begin at `offset` of the file.
    pub fn scan(&mut self, mut records: &[u8], mut offset: u64) -> Result<(), McapError> {
        while !records.is_empty() {
            let (length, body) = split_record(records)?;
            self.take(parse_record(records[0], body)?, offset, length as u64);
            records = &records[length..];
            offset += length as u64;
        }
        Ok(())
    }

    fn take(&mut self, record: Record, offset: u64, length: u64) {
        match record {
            Record::Chunk { header, .. } => {
                let first = self.chunks.is_empty();
                let s = &mut self.statistics;
                s.chunk_count += 1;
                s.message_end_time = s.message_end_time.max(header.message_end_time);
                if first || header.message_start_time < s.message_start_time {
                    s.message_start_time = header.message_start_time;
                }
                self.chunks.push(ChunkIndex {
                    message_start_time: header.message_start_time,
                    message_end_time: header.message_end_time,
                    chunk_start_offset: offset,
                    chunk_length: length,
                    message_index_offsets: Default::default(),
                    message_index_length: 0,
                    compression: header.compression,
                    compressed_size: header.compressed_size,
                    uncompressed_size: header.uncompressed_size,
                });
            }
            Record::MessageIndex(index) => {
                let n = index.records.len() as u64;
                self.statistics.message_count += n;
                *self
                    .statistics
                    .channel_message_counts
                    .entry(index.channel_id)
                    .or_default() += n;
                if let Some(chunk) = self.chunks.last_mut() {
                    chunk.message_index_offsets.insert(index.channel_id, offset);
                    chunk.message_index_length += length;
                }
            }
            Record::Metadata(metadata) => {
                self.statistics.metadata_count += 1;
                self.metadata.push(MetadataIndex {
                    offset,
                    length,
                    name: metadata.name,
                });
            }
            _ => {}
        }
    }

    /// DataEnd, summary section, Footer and magic for a data section that ends at `offset`.
    pub fn end_of_file(&self, offset: u64) -> io::Result<Vec<u8>> {
        let mut end = Vec::new();
        put(&mut end, op::DATA_END, &body_of(&DataEnd::default())?);
        let summary_start = offset + end.len() as u64;
        for (header, data) in &self.schemas {
            let mut body = body_of(header)?;
            body.extend_from_slice(&(data.len() as u32).to_le_bytes());
            body.extend_from_slice(data);
            put(&mut end, op::SCHEMA, &body);
        }
        for channel in &self.channels {
            put(&mut end, op::CHANNEL, &body_of(channel)?);
        }
        put(&mut end, op::STATISTICS, &body_of(&self.statistics)?);
        for chunk in &self.chunks {
            put(&mut end, op::CHUNK_INDEX, &body_of(chunk)?);
        }
        for metadata in &self.metadata {
            put(&mut end, op::METADATA_INDEX, &body_of(metadata)?);
        }
        let footer = Footer {
            summary_start,
            summary_offset_start: 0, // none
            summary_crc: 0,          // not computed
        };
        put(&mut end, op::FOOTER, &body_of(&footer)?);
        end.extend_from_slice(mcap::MAGIC);
        Ok(end)
    }
}

/// Length of the first record with its frame, and its body.
fn split_record(records: &[u8]) -> Result<(usize, &[u8]), McapError> {
    let (frame, rest) = records.split_at_checked(FRAME_BYTES).ok_or(McapError::UnexpectedEof)?;
    let mut length = [0; FRAME_BYTES - OP_BYTES];
    length.copy_from_slice(&frame[OP_BYTES..]);
    let n = usize::try_from(u64::from_le_bytes(length)).map_err(|_| McapError::UnexpectedEof)?;
    let body = rest.get(..n).ok_or(McapError::UnexpectedEof)?;
    Ok((FRAME_BYTES + n, body))
}

fn body_of<T>(record: &T) -> io::Result<Vec<u8>>
where
    for<'a> T: BinWrite<Args<'a> = ()>,
{
    let mut body = Vec::new();
    record.write_le(&mut Cursor::new(&mut body)).map_err(io::Error::other)?;
    Ok(body)
}

fn put(to: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    to.push(opcode);
    to.extend_from_slice(&(body.len() as u64).to_le_bytes());
    to.extend_from_slice(body);
}
