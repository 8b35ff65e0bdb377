//! The seed's figure 3: occupancy of the curb against distance, for the map and for the conventional method.

use std::path::Path;

use anyhow::{Result, anyhow};
use plotters::prelude::*;

use super::evaluation::{DISTANCES, Judged};
use crate::output;

/// Draws the figure as SVG.
///
/// # Errors
/// A file that cannot be written.
pub fn draw(judged: &Judged, path: &Path) -> Result<()> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (820, 460)).into_drawing_area();
        let failed = |error: &dyn std::fmt::Display| anyhow!("drawing {}: {error}", path.display());
        root.fill(&WHITE).map_err(|e| failed(&e))?;
        let mut chart = ChartBuilder::on(&root)
            .margin(16)
            .x_label_area_size(42)
            .y_label_area_size(52)
            .build_cartesian_2d(8f64..75f64, 0f64..1.05f64)
            .map_err(|e| failed(&e))?;
        chart
            .configure_mesh()
            .x_desc("distance to the centre of the curb frame, m")
            .y_desc("occupancy")
            .light_line_style(BLACK.mix(0.04))
            .draw()
            .map_err(|e| failed(&e))?;
        let series = |values: &[f64]| -> Vec<(f64, f64)> {
            DISTANCES.zip(values).map(|(distance, value)| (f64::from(distance), *value)).collect()
        };
        chart.draw_series(LineSeries::new([(8.0, 0.54), (75.0, 0.54)], BLACK.mix(0.4))).map_err(|e| failed(&e))?;
        for (name, values, colour) in [
            ("driving risk map", &judged.map.occupancy, RGBColor(180, 40, 30)),
            ("clusters of one frame", &judged.conventional.occupancy, RGBColor(40, 90, 170)),
        ] {
            chart
                .draw_series(LineSeries::new(series(values), colour.stroke_width(2)))
                .map_err(|e| failed(&e))?
                .label(name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.9))
            .border_style(BLACK.mix(0.3))
            .draw()
            .map_err(|e| failed(&e))?;
        root.present().map_err(|e| failed(&e))?;
    }
    output::write(path, svg.as_bytes())?;
    Ok(())
}
