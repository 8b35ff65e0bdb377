//! The table in words: for a terminal and as a page of the documentation.

use std::fmt::Write as _;

use super::{Line, Report};

/// A value in its unit, `-` where there is none.
fn value(value: Option<f64>, unit: &str) -> String {
    let Some(value) = value.filter(|value| value.is_finite()) else { return "-".to_owned() };
    match unit {
        "us" => format!("{value:.1} us"),
        "share" => format!("{:.1} %", 100.0 * value),
        _ if value.abs() < 0.1 => format!("{value:.4}\u{b0}"),
        _ => format!("{value:.3}\u{b0}"),
    }
}

fn noise(line: &Line) -> String {
    line.range_noise_mm.map_or_else(|| "-".to_owned(), |mm| format!("{mm} mm"))
}

/// The table for a terminal.
#[must_use]
pub fn table(lines: &[Line]) -> String {
    let mut text =
        format!("{:<78}{:>8}{:>9}{:>11}{:>11}{:>16}", "", "ranges", "paper", "crossfall", "limit", "paper's search");
    let mut last = "";
    for line in lines {
        if line.experiment != last {
            last = line.experiment;
            let _ = write!(text, "\n{last}");
        }
        let _ = write!(
            text,
            "\n  {:<76}{:>8}{:>9}{:>11}{:>11}{:>16}",
            line.quantity,
            noise(line),
            paper(line),
            value(Some(line.crossfall), line.unit),
            value(line.limit, line.unit),
            value(line.seed_search, line.unit)
        );
    }
    text
}

/// The paper's figure with the digits that the paper gives.
fn paper(line: &Line) -> String {
    line.paper.map_or_else(|| "-".to_owned(), |value| format!("{value}\u{b0}"))
}

/// What was simulated, for the page.
const HEAD: &str = "\
# Validation

The experiments of the median-slope paper once more, on simulated drives whose truth is known. This page and its pictures are written by

```console
$ crossfall reproduce
```

which makes sensor bytes, puts them through the board's own code into logs, and evaluates these with `calibrate` and `compare`, the commands that a user has. Everything
random is drawn from one seed. The risk map's evaluation is `crossfall reproduce terrain`, see [risk-map.md](risk-map.md); the accuracy of single sections of
many kinds is in [scenes.md](scenes.md).

## The noise

| what | model |
|---|---|
| ranges | normal along the beam, independent, rounded to 1 mm; 0.2 % of the beams without an echo. The paper says +/-35 mm and +/-3.5 mm, SICK's data sheet 10 mm (one sigma, typical): 3.5 and 10 mm are both tried as one sigma |
| roll | 0.0168 degrees that drift (first-order Gauss-Markov, 30 s) and 0.0025 degrees that are new with every pose at 100 Hz: 0.017 degrees in all, as published for the unit |
| time | pulses to the microsecond, a board clock 23 ppm fast, poses 10 to 170 ms late in spells, telegrams as late as the experiment says |
| positions | exact, but on the repeat drives 2 m (one sigma, north and east each) drifting over ten minutes |
| ground | straight slopes; on the medians 8 mm (one sigma) of undulation with wavelengths of 3 to 15 m beyond the road's edge, and where there is grass 30 % of the returns raised by an exponential height of mean 50 mm, at most 200 mm, and 1 % strays |

What a simulation cannot show is what it does not contain: a frame that moves against the vehicle in more than roll, moisture, glare, a beam's footprint on a hinge (the scanner's spot is a decimetre wide at 15 m),
the road's own roughness, and whatever the paper's operators did when they laid the inclinometer down. The paper's figures hold all of that; crossfall's do not.

## The table

*Limit* is what the sensors leave to a perfect evaluation: Cramer and Rao's bound for the returns between a slope's true ends, the unit's roll error as simulated, the
inclinometer's reading, the error of the positions. *Paper's search* is the paper's own criterion, found exactly, on the same bytes (`method = \"seed\"`).
";

/// The page `docs/validation.md`; pictures lie in `images` beside it.
#[must_use]
pub fn markdown(report: &Report, seed: u64) -> String {
    let mut text = String::from(HEAD);
    text += "\n| experiment | quantity | range noise | paper | crossfall | limit | paper's search |\n|---|---|---|---|---|---|---|\n";
    for line in &report.lines {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} |",
            line.experiment,
            line.quantity,
            noise(line),
            paper(line),
            value(Some(line.crossfall), line.unit),
            value(line.limit, line.unit),
            value(line.seed_search, line.unit)
        );
    }
    let _ = writeln!(text, "\nSeed {seed}.\n\n## Pictures");
    for picture in &report.pictures {
        let _ = write!(
            text,
            "\n<picture>\n  <source media=\"(prefers-color-scheme: dark)\" srcset=\"images/{0}-dark.svg\">\n  <img alt=\"{1}\" src=\"images/{0}.svg\">\n</picture>\n",
            picture.name, picture.says
        );
    }
    text + ABOUT
}

/// What each experiment is, for the page.
const ABOUT: &str = "
## The experiments

**Two units** (figure 2). The paper moved its one unit between vehicle and scanner and drove the path twice: 0.22 degrees mean and 0.13 degrees RMS difference, two drives' difference included. Here both units are
on one drive, the second mounted 0.22 degrees differently, the scanner's frame flexing by 0.01 degrees: `compare` on a capture with a channel `ins2`.

**Rock test** (figures 5 and 6). Parked, rocked by two degrees at 1 Hz for a minute, scanner tilted by 0.8 degrees and 1.5 ms late. The residual is the ground's slope from scan to scan, levelled beam by beam; its limit is the
ranges' noise in one scan's line over six metres and what of the unit's error moves within the minute. The offset cannot be better known than the unit's own mean error over that minute.

**Boards** (figure 7a). Two boards of 40 by 32 inches end to end, 4 to 18 degrees, the nearer end 2 to 3 m from the sensor, passed at 5 m/s; the inclinometer reads to 0.1 degrees. How the paper put its
boards together is not known.

**Medians with grass** (figure 7a). The inclinometer lies on 1.22 m of a slope that undulates; the scanner measures the whole slope. The difference of the two is a property of the ground, which is why the limit of that
line is nearly what crossfall reaches: it grows with the undulation that is simulated. The line below it is the error proper.

**Three drives** (figures 7b and 8). Slopes of single scans at the same station by the units' positions. Positions that err by metres compare different places: that is the limit. After
shifting the drives along the road by what makes their slopes agree best (one number for half a kilometre), what is left is the instrument.

**Variation** (figure 9). The paper shows that slopes vary within a section and along the road, without a number. Scanned pieces of 1.22 m follow the truth.

**What the table shows against crossfall.** On ground that undulates, the error of a scan is several times the limit, and up to a fifth of the slopes is flagged `doubtful`: the measuring mode ends a
slope where the ground leaves its line by more than noise does, follows it beyond where the ground goes on, and doubts what it cannot follow. The paper's search with its band of 25 mm finds them all, at five times the error. The undulation of 8 mm is
an assumption, and the lines grow with it.
";
