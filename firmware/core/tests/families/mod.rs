//! The second family of scenes: sections that a survey meets and would rather not, each with one thing that makes it hard.

use crate::scenes::Family;

/// The sets at one range noise, in metres.
pub fn second(noise_m: f64) -> Vec<Family> {
    let plain = |name| Family::plain(name, noise_m);
    vec![
        Family { slopes_deg: (4.0, 18.0), ..plain("4 to 18 degrees") },
        Family { adjacent_m: (1.5, 10.0), opposing_m: (1.5, 10.0), ..plain("1.5 to 10 m") },
        Family { ditch_m: (0.0, 0.0), ..plain("V ditch") },
        Family { rounded_m: 0.5, ..plain("edge rounded over 0.5 m") },
        Family { guardrail: true, ..plain("guardrail") },
        Family { grass: 0.5, ..Family::grass("grass 50 %", noise_m) },
        Family { dropouts: 0.1, ..plain("dropouts 10 %") },
        Family { roll_deg: 5.0, ..plain("roll to 5 degrees") },
        Family { has_opposing: false, ..plain("no opposing slope") },
        Family { has_opposing: false, ..Family::grass("no opposing slope, grass", noise_m) },
        Family { undulation_m: 0.008, adjacent_m: (5.0, 8.0), opposing_m: (5.0, 8.0), ..plain("undulation 8 mm") },
        Family { undulation_m: 0.015, adjacent_m: (5.0, 8.0), opposing_m: (5.0, 8.0), ..plain("undulation 15 mm") },
        Family { cut: true, ..plain("cut") },
        Family { cut: true, ..Family::grass("cut, grass", noise_m) },
        Family { slopes_deg: (0.0, 3.0), ..plain("flat, below the limits") },
        Family { slopes_deg: (0.0, 3.0), ..Family::grass("flat, grass", noise_m) },
    ]
}
