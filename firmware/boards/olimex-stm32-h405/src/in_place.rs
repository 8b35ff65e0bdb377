//! Builds the two largest states where they will stay.
//!
//! They are 17 and 13 KiB: on a stack of 16 KiB the first has no room and the second leaves too little. The compiler cannot be made to write a returned value straight
//! into a static: it builds it on the stack and moves it. The C calling convention can: a result larger than a word is written to the address in r0, the
//! arguments follow in r1 and r2 (AAPCS32, 6.4 and 6.5).

use core::arch::asm;
use core::mem::MaybeUninit;

use crossfall_core::instrument::{Decode, Identity, Survey};
use crossfall_protocol::Config;

// The results never reach C: only the convention by which they are returned is wanted.
#[allow(improper_ctypes_definitions)]
extern "C" fn make_survey() -> Survey {
    Survey::new()
}

#[allow(improper_ctypes_definitions)]
extern "C" fn make_decode(config: &Config, identity: &Identity) -> Decode {
    Decode::new(*config, identity.clone())
}

/// Calls a function of the C convention with the address of its result and two arguments. What a call may change is listed rather than
/// named by `clobber_abi("C")`, which also names registers that this core lacks.
macro_rules! call {
    ($make:ident, $place:expr, $first:expr, $second:expr) => {
        asm!(
            "bl {make}",
            make = sym $make,
            inout("r0") $place => _,
            inout("r1") $first => _,
            inout("r2") $second => _,
            out("r3") _, out("r12") _, out("lr") _,
            out("d0") _, out("d1") _, out("d2") _, out("d3") _,
            out("d4") _, out("d5") _, out("d6") _, out("d7") _,
        )
    };
}

/// A survey at boot.
pub fn survey(place: &mut MaybeUninit<Survey>) -> &mut Survey {
    // SAFETY: calls `make_survey` by the convention above, with `place` for its result, which it writes whole.
    unsafe {
        call!(make_survey, place.as_mut_ptr(), 0, 0);
        place.assume_init_mut()
    }
}

/// A decode layer at boot.
pub fn decode<'p>(place: &'p mut MaybeUninit<Decode>, config: &Config, identity: &Identity) -> &'p mut Decode {
    // SAFETY: calls `make_decode` likewise; its arguments outlive the call.
    unsafe {
        call!(make_decode, place.as_mut_ptr(), config, identity);
        place.assume_init_mut()
    }
}
