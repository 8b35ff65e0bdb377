//! What the report says in words and numbers.

use std::fmt::Write;

use super::escaped;
use super::strip::{ONE_IN_FOUR_DEG, thousands};
use crate::calendar::{Date, unix_of_gps};
use crate::drive::{Drive, Unit};
use crate::intervals::{MILE_M, Sample, Samples};
use crate::side::{Side, WhichSlope};
use crate::units::{degrees, metres};

/// One line under the title: when, where, how far, with what.
pub fn subtitle(drive: &Drive) -> String {
    let mut parts = Vec::new();
    let known: Vec<f64> = drive.scans.iter().map(|scan| scan.gps_seconds).filter(|s| s.is_finite()).collect();
    if let (Some(week), Some(&first), Some(&last)) = (drive.gps_week, known.first(), known.last()) {
        let clock = |seconds: f64| {
            let ahead = crate::leap::seconds(week, seconds as u64) as f64;
            let s = (seconds - ahead).rem_euclid(86_400.0) as u64;
            format!("{:02}:{:02}:{:02}", s / 3_600, s / 60 % 60, s % 60)
        };
        let date = Date::of_unix(unix_of_gps(week, first as u64));
        parts.push(format!("{date} {} to {} UTC", clock(first), clock(last)));
    }
    if let Some(scan) = drive.scans.iter().find(|scan| scan.place[0].is_finite()) {
        let [latitude, longitude, _] = scan.place;
        let letter = |value: f64, letters: [char; 2]| letters[usize::from(value < 0.0)];
        parts.push(format!(
            "from {:.5}\u{b0}\u{202f}{} {:.5}\u{b0}\u{202f}{}",
            latitude.abs(),
            letter(latitude, ['N', 'S']),
            longitude.abs(),
            letter(longitude, ['E', 'W'])
        ));
    }
    if let Some((firmware, board)) = &drive.identity {
        parts.push(format!("{} ({})", escaped(firmware), escaped(board)));
    }
    parts.join(" \u{b7} ")
}

/// The figures that matter most.
pub fn tiles(drive: &Drive) -> String {
    let mut html = String::new();
    let mut tile = |value: &str, what: &str, class: &str| {
        let _ = write!(html, "<div class=\"tile {class}\"><b>{value}</b><span>{what}</span></div>");
    };
    let length_m = drive.span_m().map(|(from, to)| to - from).filter(|length| *length > 1.0);
    if let Some(length_m) = length_m {
        let metric = if length_m < 10_000.0 {
            format!("{} m", thousands(length_m))
        } else {
            format!("{:.1} km", length_m / 1e3)
        };
        tile(&metric, &format!("{:.2} miles of road", length_m / MILE_M), "");
    }
    tile(&thousands(drive.scans.len() as f64), "sections measured", "");
    let slopes: usize =
        drive.scans.iter().map(|scan| scan.slopes.iter().filter(|slope| slope.0.is_finite()).count()).sum();
    match length_m {
        Some(length_m) => tile(&thousands(slopes as f64 / (length_m / MILE_M)), "slopes a mile", ""),
        None => tile(&thousands(slopes as f64), "slopes", ""),
    }
    let mut half = Samples::default();
    for scan in &drive.scans {
        let halves = scan.slopes.iter().map(|slope| f64::from(slope.1)).filter(|half| half.is_finite());
        halves.for_each(|one| half.push(Sample::new(one, f64::NAN, scan.station_m)));
    }
    if let Some(half) = half.median() {
        tile(&format!("\u{b1}{half:.2}\u{b0}"), "95 % interval of one slope, median", "");
    }
    if drive.is_whole() {
        tile("whole", "nothing was lost on the way", "good");
    } else {
        tile("losses", "see Health", "bad");
    }
    html
}

/// One line a mile: the four slopes, of the sections that can be relied on.
pub fn miles(drive: &Drive) -> String {
    let Some((from, to)) = drive.span_m() else {
        return "<p>The log has no speed to tell stations from.</p>".to_owned();
    };
    let mut html = String::from("<table><thead><tr><th>station, miles</th><th>sections</th><th>left out</th>");
    for slope in WhichSlope::ALL {
        let _ = write!(html, "<th>{}</th><th>steeper than 1:4</th>", slope.name());
    }
    html += "</tr></thead><tbody>";
    // Miles by station, as in `profiles --summary`: the same sections in each.
    let mile_of = |station_m: f64| (station_m / MILE_M).floor() as i64;
    let first = mile_of(from);
    let mut sorted: Vec<Mile> = vec![Mile::default(); (mile_of(to) - first + 1).max(1) as usize];
    for scan in drive.scans.iter().filter(|scan| scan.station_m.is_finite()) {
        let Some(mile) = sorted.get_mut((mile_of(scan.station_m) - first) as usize) else { continue };
        mile.scans += 1;
        mile.left_out += u64::from(Side::BOTH.iter().any(|side| !scan.is_reliable(*side)));
        for (slope, (samples, steep)) in WhichSlope::ALL.into_iter().zip(&mut mile.slopes) {
            let Some((value, ci95)) = scan.reliable(slope) else { continue };
            samples.push(Sample::new(value, ci95, scan.station_m));
            *steep += u64::from(value.abs() > ONE_IN_FOUR_DEG);
        }
    }
    for (mile, Mile { scans, left_out, slopes }) in (first..).zip(&sorted) {
        let (begin, end) = (mile as f64, (to / MILE_M).min(mile as f64 + 1.0));
        let miles = match drive.unit() {
            Unit::Scans { .. } => "the vehicle stood".to_owned(),
            // The last mile may be a few steps.
            Unit::Metres if end - begin < 0.05 => format!("{begin:.0}\u{2013}{end:.2}"),
            Unit::Metres => format!("{begin:.0}\u{2013}{end:.1}"),
        };
        let _ = write!(html, "<tr><td>{miles}</td><td>{}</td>", thousands(*scans as f64));
        let _ = write!(html, "<td>{}</td>", thousands(*left_out as f64));
        for (samples, steep) in slopes {
            match samples.estimate() {
                Some(one) => {
                    let share = 100.0 * *steep as f64 / one.count as f64;
                    let _ = write!(html, "<td>{}</td><td>{share:.0} %</td>", with_interval(one.value, one.ci95));
                }
                None => html += "<td>\u{2013}</td><td>\u{2013}</td>",
            }
        }
        html += "</tr>";
    }
    html + "</tbody></table>"
}

/// What is known of one mile.
#[derive(Clone, Debug, Default)]
struct Mile {
    scans: u64,
    /// Scans of which one side at least says itself unreliable.
    left_out: u64,
    /// Each slope with the number of those steeper than 1:4.
    slopes: [(Samples, u64); 4],
}

fn with_interval(value: f64, half: f64) -> String {
    let sign = if value < 0.0 { "\u{2212}" } else { "+" };
    format!("{sign}{:.2}\u{b0}\u{202f}<i>\u{b1}{half:.2}</i>", value.abs())
}

/// How the instrument did.
pub fn health(drive: &Drive) -> String {
    let health = &drive.health;
    let mut rows = String::new();
    let mut row = |what: &str, value: String, good: bool| {
        let class = if good { "good" } else { "bad" };
        let _ = write!(rows, "<tr><td>{what}</td><td class=\"{class}\">{value}</td></tr>");
    };
    let count = |n: u64| thousands(n as f64);
    row("parts of the log damaged or missing", count(health.passed_over()), health.passed_over() == 0);
    let restarts = health.totals.restarts();
    row("restarts of the board", count(restarts), restarts == 0);
    for (name, lost) in health.totals.losses() {
        row(&format!("counted by the board: {name}"), count(lost), false);
    }
    let share = |part: u64| format!("{:.1} %", 100.0 * part as f64 / health.poses.max(1) as f64);
    row("pulses accepted", count(health.pulses), health.pulses > 0);
    row("pulses that fitted no second", count(health.pulses_spurious), health.pulses_spurious == 0);
    row(
        "poses timed by pulses",
        format!("{} of {}", share(health.poses_by_pulse), count(health.poses)),
        health.poses_by_pulse * 20 >= health.poses * 19,
    );
    row("poses in the inertial unit's good state", share(health.poses_good), health.poses_good == health.poses);
    if let Some(drift) = health.drift_ppm {
        row("the board's clock against GPS", format!("{drift:+.2} ppm").replace('-', "\u{2212}"), drift.abs() < 100.0);
    }
    let scans = drive.scans.len().max(1) as f64;
    for (flag, what) in Drive::OF_THE_INSTRUMENT {
        let flagged = drive.flagged(flag);
        if flagged > 0 {
            row(
                &format!("sections {what}"),
                format!("{} ({:.1} %)", count(flagged), 100.0 * flagged as f64 / scans),
                false,
            );
        }
    }
    for side in Side::BOTH {
        let unreliable = drive.unreliable(side);
        if unreliable > 0 {
            row(
                &format!("sections doubtful or without attitude on the {}: left out of means", side.name()),
                format!("{} ({:.1} %)", count(unreliable), 100.0 * unreliable as f64 / scans),
                unreliable as f64 * 10.0 < scans,
            );
        }
    }
    for slope in WhichSlope::ALL {
        let found = drive.found(slope);
        row(
            &format!("{} slope found and to be relied on", slope.name()),
            format!("{:.1} %", 100.0 * found),
            found > 0.5,
        );
    }
    format!("<table class=\"plain\"><tbody>{rows}</tbody></table>")
}

/// What the slopes were measured with.
pub fn calibration(drive: &Drive) -> String {
    let config = &drive.config;
    let [forward, left, up] = config.ins.lever_arm_mm;
    let limits = config.survey.limits;
    let rows = [
        ("mounting offset of the scanner", format!("{:.4}\u{b0}", degrees(config.scanner.mounting_offset))),
        ("delay of the scanner", format!("{:.3} ms", f64::from(config.scanner.delay_us) / 1e3)),
        ("scanner mounted mirrored", if config.scanner.mirrored { "yes" } else { "no" }.to_owned()),
        ("from the inertial unit to the scanner", format!("{forward} mm forward, {left} mm left, {up} mm up")),
        ("method", format!("{:?}", config.survey.method).to_lowercase()),
        ("length of a slope", format!("{:.1} to {:.1} m", metres(limits.min_length_um), metres(limits.max_length_um))),
        (
            "inclination of a slope",
            format!("{:.1}\u{b0} to {:.1}\u{b0}", degrees(limits.min_slope), degrees(limits.max_slope)),
        ),
        ("an obstruction stands out by", format!("{:.0} mm", f64::from(limits.obstruction_um) / 1e3)),
    ];
    let rows: String = rows
        .iter()
        .map(|(what, value)| format!("<tr><td>{what}</td><td>{}</td></tr>", value.replace('-', "\u{2212}")))
        .collect();
    format!("<table class=\"plain\"><tbody>{rows}</tbody></table>")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::Scan;

    fn drive(stations: impl Iterator<Item = f64>) -> Drive {
        let scan = |(number, station_m)| Scan {
            gps_seconds: 160_203.0,
            slopes: [(-8.0, 0.1); 4],
            ..Scan::at(number, station_m)
        };
        Drive { scans: (0..).zip(stations).map(scan).collect(), gps_week: Some(1_820), ..Drive::default() }
    }

    /// Of each row its first two cells.
    fn rows(html: &str) -> Vec<(&str, &str)> {
        html.split("<tr><td>")
            .skip(1)
            .filter_map(|row| row.split_once("</td><td>"))
            .filter_map(|(mile, rest)| Some((mile, rest.split_once("</td>")?.0)))
            .collect()
    }

    #[test]
    fn miles_are_counted_by_station() {
        // A section every five metres from 11 m on: 320 before 1609.344 m.
        let html = miles(&drive((0..420).map(|i| 11.0 + 5.0 * f64::from(i))));
        assert_eq!(rows(&html), [("0\u{2013}1.0", "320"), ("1\u{2013}1.3", "100")]);
        let html = miles(&drive((0..330).map(|i| 11.0 + 5.0 * f64::from(i))));
        assert_eq!(rows(&html), [("0\u{2013}1.0", "320"), ("1\u{2013}1.03", "10")]);
        assert_eq!(rows(&miles(&drive([0.0; 9].into_iter()))), [("the vehicle stood", "9")]);
        let html = miles(&drive((0..10).map(|i| 1_700.0 + f64::from(i))));
        assert_eq!(rows(&html), [("1\u{2013}1.1", "10")]);
    }

    #[test]
    fn times_are_utc_of_their_day() {
        // 24 November 2014, when GPS was 16 seconds ahead.
        assert_eq!(subtitle(&drive([0.0].into_iter())), "2014-11-24 20:29:47 to 20:29:47 UTC");
    }
}
