//! What ends a closed file: the index behind its data, the footer, and a mark.
//!
//! Nothing here is needed to read the frames. But what has changed in it is told as anything else is.

use mcap::records::op;

use super::{Container, Error, FOOTER, HEAD};

/// Length of what ends a file: the footer's record and the mark.
const CLOSING: u64 = HEAD + FOOTER + mcap::MAGIC.len() as u64;

/// Bytes of the closing records that are the same in every file and may be wrong, and they are known all the same.
const CLOSING_WRONG: usize = 2;

/// What the footer's CRC says of the index.
#[derive(Debug)]
pub(crate) enum Index {
    /// Nothing of it has changed.
    Sound,
    /// Some of it has.
    Damaged(Error),
}

/// What ends a file.
pub(super) struct Closing {
    /// Of the index; 0 where its writer has made none.
    crc: u32,
    head_wrong: bool,
    mark_wrong: bool,
}

impl Container {
    /// What is wrong with the index that lies between the end of the data at `from` and the end of the file, by the CRC that the footer has of it (MCAP
    /// specification, "Footer": of everything up to this CRC). The walk ends here then, and also where nothing is wrong. None where nobody can say: without a
    /// CRC, without a footer at the end of the file, or with chunks behind the data's end.
    pub fn index(&mut self, from: u64) -> Result<Option<Index>, Error> {
        let Some(footer) = self.size.checked_sub(CLOSING).filter(|&footer| footer >= from) else { return Ok(None) };
        let Some(Closing { crc, head_wrong, mark_wrong }) = self.closing()? else { return Ok(None) };
        if (crc, head_wrong, mark_wrong) == (0, false, false) {
            return Ok(None);
        }
        let actual = self.checksum_of(from, self.size - mcap::MAGIC.len() as u64 - 4)?;
        let what = if actual == crc && !mark_wrong {
            None
        } else if self.chunk_between(from, footer)?.is_some() {
            return Ok(None);
        } else if actual == crc {
            Some("the mark that ends the file has changed".to_owned())
        } else {
            Some(format!("the CRC of the index behind the data is {actual:08X}, expected {crc:08X}"))
        };
        (self.position, self.closed) = (self.size, true);
        Ok(Some(match what {
            None => Index::Sound,
            Some(what) => {
                Index::Damaged(self.damaged(from, format!("{what}: no frame is lost, the index is not needed")))
            }
        }))
    }

    /// What ends the file, if it is a footer, even where a byte or two of it have changed.
    pub(super) fn closing(&mut self) -> Result<Option<Closing>, Error> {
        let Some(footer) = self.size.checked_sub(CLOSING) else { return Ok(None) };
        let closing = self.bytes(footer, CLOSING as usize)?;
        let (head, rest) = closing.split_at(HEAD as usize);
        let (fields, mark) = rest.split_at(FOOTER as usize);
        let expected_head = [[op::FOOTER].as_slice(), &FOOTER.to_le_bytes()].concat();
        let wrong = |found: &[u8], expected: &[u8]| found.iter().zip(expected).filter(|(a, b)| a != b).count();
        let (head, mark) = (wrong(head, &expected_head), wrong(mark, mcap::MAGIC));
        let crc = fields.last_chunk().map_or(0, |crc| u32::from_le_bytes(*crc));
        let closing = Closing { crc, head_wrong: head > 0, mark_wrong: mark > 0 };
        Ok((head + mark <= CLOSING_WRONG).then_some(closing))
    }
}
