//! What records hold: the channels and messages of a chunk, packed or not, or of one outside of any.
//!
//! What comes before damage is kept, with where the damage is.

use std::io::{self, Read};

use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::chunk_head::ChunkHead;
use super::{Container, Entry, Error, HEAD, MAX_CHUNK};

/// A channel: its number in this file and its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChannelName {
    pub id: u16,
    pub topic: String,
}

/// A message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Message {
    /// Where the message's record is; in a compressed chunk, where the chunk is.
    pub offset: u64,
    pub channel: u16,
    /// The record's own number; writers here count all records of a recording.
    pub sequence: u32,
    /// Nanoseconds.
    pub log_time: u64,
    /// Nanoseconds; writers here give both times the same value.
    pub publish_time: u64,
    pub data: Vec<u8>,
}

/// What a chunk, or a message outside of any, holds.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    pub channels: Vec<ChannelName>,
    pub messages: Vec<Message>,
    /// Bytes of the record that were understood.
    pub read: u64,
    /// What kept the rest from being read.
    pub error: Option<Error>,
}

impl Container {
    /// Everything in a chunk, a channel record or a message record of the top level.
    pub fn contents(&mut self, entry: Entry) -> Contents {
        let mut contents = Contents::default();
        let result = match entry.opcode {
            op::CHUNK => self.chunk(entry, &mut contents),
            op::CHANNEL | op::MESSAGE => {
                self.body(entry).and_then(|body| self.keep(entry.offset, entry.opcode, &body, &mut contents))
            }
            _ => Ok(()),
        };
        contents.error = result.err();
        contents
    }

    fn chunk(&mut self, entry: Entry, contents: &mut Contents) -> Result<(), Error> {
        let room = self.size.saturating_sub(entry.offset + HEAD);
        let here = entry.length.min(room);
        if here > MAX_CHUNK {
            return Err(self.damaged(entry.offset, format!("a chunk of {here} bytes, expected at most {MAX_CHUNK}")));
        }
        let mut body = vec![0; here as usize];
        self.read_at(entry.offset + HEAD, &mut body)?;
        let Some(head) = ChunkHead::parse(&body) else {
            return Err(if entry.length > room {
                self.cut(format!("inside of the chunk that began at byte {}", entry.offset))
            } else {
                self.damaged(entry.offset, "the chunk's header is not readable".to_owned())
            });
        };
        if head.unpacked > MAX_CHUNK {
            let what = format!("a chunk of {} bytes, expected at most {MAX_CHUNK}", head.unpacked);
            return Err(self.damaged(entry.offset, what));
        }
        let result = if head.compression.is_empty() {
            self.plain_records(entry, &body, &head, contents)
        } else {
            self.packed_records(entry, &body, head.unpacked, contents)
        };
        // A cut chunk fails somehow; that it is cut is what the user needs to know.
        if entry.length > room {
            return Err(self.cut(format!("inside of the chunk that began at byte {}", entry.offset)));
        }
        result
    }

    /// Records of an uncompressed chunk: they lie in the file as they are, so each has its place.
    fn plain_records(&self, entry: Entry, body: &[u8], head: &ChunkHead, contents: &mut Contents) -> Result<(), Error> {
        let mut rest = body.get(head.records_at..).unwrap_or_default();
        rest = rest.get(..usize::try_from(head.packed).unwrap_or(usize::MAX)).unwrap_or(rest);
        let (actual, crc) = (crc32fast::hash(rest), head.crc);
        let end = entry.offset + HEAD + (head.records_at + rest.len()) as u64;
        contents.read = HEAD + head.records_at as u64;
        while let Some((&[opcode, ref length @ ..], after)) = rest.split_first_chunk::<{ HEAD as usize }>() {
            let offset = end - rest.len() as u64;
            let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
            let Some((record, next)) = after.split_at_checked(length) else {
                return Err(self
                    .damaged(offset, format!("a record of {length} bytes, of which its chunk holds {}", after.len())));
            };
            self.keep(offset, opcode, record, contents)?;
            contents.read += HEAD + length as u64;
            rest = next;
        }
        // The messages are kept even so: what is in them has checks of its own.
        if crc != 0 && actual != crc {
            return Err(self.damaged(entry.offset, format!("the chunk's CRC is {actual:08X}, expected {crc:08X}")));
        }
        if !rest.is_empty() {
            return Err(self.damaged(entry.offset, format!("the chunk ends with {} stray bytes", rest.len())));
        }
        Ok(())
    }

    /// Records of a compressed chunk, through the crate's reader.
    fn packed_records(&self, entry: Entry, body: &[u8], unpacked: u64, contents: &mut Contents) -> Result<(), Error> {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(MAX_CHUNK as usize);
        let mut reader = LinearReader::new_with_options(options);
        let mut total = 0;
        let mut input = io::Cursor::new([[op::CHUNK].as_slice(), &entry.length.to_le_bytes()].concat()).chain(body);
        while let Some(event) = reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    // In-memory reading does not fail; less than wanted means the end.
                    let got = input.read(reader.insert(wanted.min(1 << 20))).unwrap_or(0);
                    reader.notify_read(got);
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    // Some bytes can be packed for a million: no more comes out than the chunk has announced.
                    total += HEAD + data.len() as u64;
                    if total > unpacked {
                        let what = format!("a chunk of more than the {unpacked} bytes that it announces");
                        return Err(self.damaged(entry.offset, what));
                    }
                    self.keep(entry.offset, opcode, data, contents)?;
                }
                Err(error) => return Err(self.damaged(entry.offset, error.to_string())),
            }
        }
        Ok(())
    }

    fn keep(&self, offset: u64, opcode: u8, body: &[u8], contents: &mut Contents) -> Result<(), Error> {
        match opcode {
            op::CHANNEL | op::MESSAGE => {}
            op::SCHEMA => return Ok(()),
            _ => return Err(self.damaged(offset, format!("a record {opcode:02X}, expected a channel or a message"))),
        }
        match mcap::parse_record(opcode, body) {
            Ok(Record::Channel(channel)) => {
                let pairs: usize = channel.metadata.iter().map(|(key, value)| 8 + key.len() + value.len()).sum();
                if body.len() != 16 + channel.topic.len() + channel.message_encoding.len() + pairs {
                    return Err(self.damaged(offset, "a channel record that does not fill its length".to_owned()));
                }
                contents.channels.push(ChannelName { id: channel.id, topic: channel.topic });
            }
            Ok(Record::Message { header, data }) => contents.messages.push(Message {
                offset,
                channel: header.channel_id,
                sequence: header.sequence,
                log_time: header.log_time,
                publish_time: header.publish_time,
                data: data.into_owned(),
            }),
            Ok(_) => {}
            Err(_) => return Err(self.damaged(offset, "a channel or message record that is not readable".to_owned())),
        }
        Ok(())
    }
}
