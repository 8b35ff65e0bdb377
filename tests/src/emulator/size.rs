//! How much of the board's memory an image takes, from its program headers.

use std::path::Path;

use object::elf::FileHeader32;
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Endianness, elf};

/// Start of the flash; RAM and core-coupled RAM lie elsewhere (the board's `memory.x`).
const FLASH: std::ops::Range<u32> = 0x0800_0000..0x0810_0000;
const RAM: std::ops::Range<u32> = 0x2000_0000..0x2002_0000;

/// Bytes of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Size {
    /// Code, tables, and the initial values of variables.
    pub flash: u32,
    /// Variables.
    pub ram: u32,
}

/// The size of an image.
///
/// # Errors
/// When the file is no 32-bit ELF.
pub fn size(image: &Path) -> Result<Size, String> {
    let told = |error: String| format!("{}: {error}", image.display());
    let bytes = std::fs::read(image).map_err(|error| told(error.to_string()))?;
    let header = FileHeader32::<Endianness>::parse(&*bytes).map_err(|error| told(error.to_string()))?;
    let endian = header.endian().map_err(|error| told(error.to_string()))?;
    let segments = header.program_headers(endian, &*bytes).map_err(|error| told(error.to_string()))?;
    let mut size = Size::default();
    for segment in segments.iter().filter(|segment| segment.p_type(endian) == elf::PT_LOAD) {
        if FLASH.contains(&segment.p_paddr(endian)) {
            size.flash += segment.p_filesz(endian);
        }
        if RAM.contains(&segment.p_vaddr(endian)) {
            size.ram += segment.p_memsz(endian);
        }
    }
    Ok(size)
}

/// Bytes of static RAM of an image that was just built.
///
/// # Panics
/// When it is no image.
#[must_use]
pub fn ram_used(image: &Path) -> u32 {
    size(image).expect("an image").ram
}
