//! The same pictures as PNG: what was drawn as SVG, rendered, so that there is one way to draw.

use std::sync::{Arc, OnceLock};

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use super::Error;

/// Pixels of the PNG for one of the SVG: sharp on paper and on dense screens.
const SCALE: f32 = 2.0;

/// Renders a picture.
///
/// # Errors
/// When no font is installed: a picture without its words would be no picture.
pub fn png(svg: &str) -> Result<Vec<u8>, Error> {
    let wrap = |error: &dyn std::fmt::Display| Error(error.to_string());
    let fonts =
        fonts().ok_or_else(|| Error("no font is installed (Debian: apt install fonts-dejavu-core)".to_owned()))?;
    let options = Options { fontdb: fonts, ..Options::default() };
    let tree = Tree::from_str(svg, &options).map_err(|e| wrap(&e))?;
    let size = tree.size().to_int_size().scale_by(SCALE).ok_or_else(|| wrap(&"it has no size"))?;
    let mut pixels = Pixmap::new(size.width(), size.height()).ok_or_else(|| wrap(&"it is too large"))?;
    resvg::render(&tree, Transform::from_scale(SCALE, SCALE), &mut pixels.as_mut());
    encode(&pixels).map_err(|e| wrap(&e))
}

/// The pictures have an opaque ground: their alpha says nothing.
fn encode(pixels: &Pixmap) -> Result<Vec<u8>, png::EncodingError> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, pixels.width(), pixels.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    let colours: Vec<u8> = pixels.data().chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&colours)?;
    writer.finish()?;
    Ok(file)
}

/// The system's fonts, read once; nothing when there is none.
fn fonts() -> Option<Arc<fontdb::Database>> {
    static FONTS: OnceLock<Option<Arc<fontdb::Database>>> = OnceLock::new();
    FONTS
        .get_or_init(|| {
            let mut fonts = fontdb::Database::new();
            fonts.load_system_fonts();
            let families = ["DejaVu Sans", "Liberation Sans", "Noto Sans", "Arial", "Helvetica"];
            let has = |name: &str| fonts.faces().any(|face| face.families.iter().any(|family| family.0 == name));
            let known = families.into_iter().find(|name| has(name)).map(str::to_owned);
            let any = || fonts.faces().next().and_then(|face| face.families.first()).map(|family| family.0.clone());
            let family = known.or_else(any)?;
            fonts.set_sans_serif_family(family);
            Some(Arc::new(fonts))
        })
        .clone()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_has_twice_its_size_and_its_colours() {
        let svg = r##"<svg xmlns="http://www.w3.org/2000/svg" width="20" height="10"><rect width="20" height="10" fill="#102030"/></svg>"##;
        match png(svg) {
            Ok(file) => {
                let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().unwrap();
                let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
                let frame = reader.next_frame(&mut pixels).unwrap();
                assert_eq!((frame.width, frame.height), (40, 20));
                assert_eq!(&pixels[..3], [0x10, 0x20, 0x30]);
            }
            Err(error) => assert!(error.to_string().contains("no font is installed"), "{error}"),
        }
    }
}
