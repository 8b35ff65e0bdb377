//! What a simulated drive really was, one row a scan.

use std::io::{self, Write};

use super::section::Section;
use crate::table::rounded;

/// The truth of one scan. The section is the one at the mean time of its beams.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// 0-based number of the scan.
    pub scan: usize,
    /// Device time of its first beam.
    pub start_device_s: f64,
    /// Roll at the beam that looks straight down.
    pub roll_deg: f64,
    /// Place along the road.
    pub station_m: f64,
    /// The ground.
    pub section: Section,
}

/// Header of the file. The first nine columns are those of the contract, with the left side's values.
pub const COLUMNS: &str = "scan,start_device_s,roll_deg,road_deg,edge_y_m,adjacent_deg,adjacent_end_y_m,\
    opposing_deg,opposing_end_y_m,opposing_start_y_m,station_m,sensor_height_m,right_road_deg,right_edge_y_m,\
    right_adjacent_deg,right_adjacent_end_y_m,right_opposing_deg,right_opposing_end_y_m,right_opposing_start_y_m";

/// Writes the table.
///
/// # Errors
/// When the writer fails.
pub fn write_csv(rows: &[Row], mut out: impl Write) -> io::Result<()> {
    writeln!(out, "{COLUMNS}")?;
    for row in rows {
        let Section { height_m, cross_slope_deg, left, right } = row.section;
        write!(out, "{},{:.6},{:.5}", row.scan, row.start_device_s, rounded(row.roll_deg, 5))?;
        let of_left = [
            cross_slope_deg,
            left.edge_m,
            left.adjacent_slope_deg,
            left.adjacent_end_m(),
            left.opposing_slope_deg,
            left.opposing_end_m(),
            left.opposing_start_m(),
        ];
        for value in of_left {
            write!(out, ",{:.5}", rounded(value, 5))?;
        }
        write!(out, ",{:.3},{height_m:.5}", row.station_m)?;
        let of_right = [
            -cross_slope_deg,
            -right.edge_m,
            right.adjacent_slope_deg,
            -right.adjacent_end_m(),
            right.opposing_slope_deg,
            -right.opposing_end_m(),
            -right.opposing_start_m(),
        ];
        for value in of_right {
            write!(out, ",{:.5}", rounded(value, 5))?;
        }
        writeln!(out)?;
    }
    Ok(())
}
