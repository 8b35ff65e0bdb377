//! The way back from a frame to its payload and check, by blocks.
//!
//! In consistent overhead byte stuffing (Cheshire and Baker, 1999) a marker says how many bytes follow before the next zero, or before the next marker when it is
//! 255. The `cobs` crate, which writes the frames, reads them byte by byte; whoever proves a log of hours reads them by the million, and takes a block at
//! a time. Both agree on every byte string: the test below.

/// The bytes that a code stands for, its delimiter left off, at the start of `plain`. Nothing when it is no code, or there is no room.
pub fn unstuff<'a>(code: &[u8], plain: &'a mut [u8]) -> Option<&'a [u8]> {
    let (mut rest, mut len) = (code, 0);
    while let Some((&marker, following)) = rest.split_first() {
        let run = usize::from(marker).checked_sub(1)?;
        let (block, following) = following.split_at_checked(run)?;
        let place = plain.get_mut(len..)?.get_mut(..run)?;
        place.copy_from_slice(block);
        len += run;
        rest = following;
        // A zero between two blocks; none after the last, nor after one that is full.
        if marker != u8::MAX && !rest.is_empty() {
            *plain.get_mut(len)? = 0;
            len += 1;
        }
    }
    plain.get(..len)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;

    /// What the library makes of the same code with its delimiter.
    fn by_the_library(code: &[u8], room: usize) -> Option<std::vec::Vec<u8>> {
        let (mut with_delimiter, mut plain) = (code.to_vec(), std::vec![0; room]);
        with_delimiter.push(0);
        let report = cobs::decode(&with_delimiter, &mut plain).ok()?;
        plain.truncate(report.frame_size());
        Some(plain)
    }

    fn by_blocks(code: &[u8], room: usize) -> Option<std::vec::Vec<u8>> {
        unstuff(code, &mut std::vec![0; room]).map(<[u8]>::to_vec)
    }

    proptest! {
        #[test]
        fn any_bytes_without_a_zero_stand_for_what_the_library_says(
            code in vec(prop_oneof![1u8..=255, 1u8..6, Just(255u8)], 1..700), room in prop_oneof![Just(900usize), 0usize..40],
        ) {
            prop_assert_eq!(by_blocks(&code, room), by_the_library(&code, room));
        }

        #[test]
        fn every_payload_comes_back(payload in vec(prop_oneof![any::<u8>(), Just(0u8), 1u8..], 0..700)) {
            let mut code = std::vec![0; cobs::max_encoding_length(payload.len())];
            let len = cobs::encode(&payload, &mut code);
            prop_assert_eq!(by_blocks(&code[..len], 700), Some(payload));
        }
    }

    #[test]
    fn full_blocks_and_ends_are_as_the_library_has_them() {
        for length in [253, 254, 255, 508, 509] {
            let payload = std::vec![7; length];
            let mut code = std::vec![0; cobs::max_encoding_length(length)];
            let len = cobs::encode(&payload, &mut code);
            assert_eq!(by_blocks(&code[..len], length), Some(payload));
            assert_eq!(by_blocks(&code[..len], length - 1), None);
        }
        assert_eq!(by_blocks(&[2], 9), None);
        assert_eq!(by_blocks(&[1], 9), Some(std::vec![]));
        assert_eq!(by_blocks(&[1, 1], 9), Some(std::vec![0]));
    }
}
