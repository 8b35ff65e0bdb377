//! Which vector instructions the map's loops become.
//!
//! Most of a frame's work is loops over arrays of a fixed size, which compilers turn into vector instructions: those that the program was built for.
//! A host that finds out when it runs that its processor has wider ones hands over a [`Vectors`] that compiles each loop for these as well. The
//! operations are the same, lane by lane, and so are the bits of the map.

/// Runs loops that are meant for a vector unit.
pub trait Vectors: Copy {
    /// Runs one. It is to be a function of its own: inlined into what surrounds it, LLVM leaves it scalar, up to 30 times slower.
    fn run<R>(self, kernel: impl FnOnce() -> R) -> R;
}

/// The vector instructions that the program was built for.
#[derive(Clone, Copy, Debug, Default)]
pub struct AsBuilt;

impl Vectors for AsBuilt {
    #[inline(never)]
    fn run<R>(self, kernel: impl FnOnce() -> R) -> R {
        kernel()
    }
}
