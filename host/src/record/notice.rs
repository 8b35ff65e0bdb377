//! What the user is told while a recording goes on, in a line each.

use std::fmt;

use crossfall_core::protocol::Config;
use crossfall_core::protocol::schema;

use super::SILENCE;
use crate::config::to_toml;
use crate::log::PARTS;
use crate::units::degrees;

/// What the user should be told while the recording goes on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Notice {
    /// A board said who it is, and it is not who it was.
    Board {
        /// Name and version of its firmware.
        firmware: String,
        /// Its name.
        board: String,
        /// The hash of the messages it speaks.
        schema: u64,
    },
    /// The board has booted again.
    Restarted {
        /// Its own words, empty after power-on.
        why: String,
    },
    /// The connection is gone; it is tried again until it is back.
    Gone {
        /// What the operating system said.
        why: String,
    },
    /// Bytes come again.
    Back,
    /// Connected, and nothing comes.
    Silent,
    /// Bytes found no room because the log could not be written fast enough.
    Overflow {
        /// How many.
        bytes: u64,
    },
    /// Another file should begin, and the numbers of files are used up: this one grows on.
    LastFile,
    /// Another file should begin and cannot be made: this one grows on, and the next is tried again.
    NoNextFile {
        /// What the operating system said, and of which file.
        why: String,
    },
    /// The next file could be made after all.
    NextFile,
    /// The device can be read and not written to: no command reaches a board there.
    Mute {
        /// What the operating system said.
        why: String,
    },
    /// The board has echoed the configuration that it was to have.
    InForce {
        /// It.
        config: Config,
        /// Whether it had been in force before: the board has restarted since.
        again: bool,
        /// Profiles that came meanwhile: measured with another configuration.
        profiles: u64,
    },
    /// The configuration that the board was to have is not in force, and is not tried any more until the next hello.
    Unconfigured {
        /// Why not.
        why: Unconfigured,
        /// What the board has echoed last.
        echoed: Option<Config>,
    },
    /// The board measures with another configuration than before, and nobody has asked for it here.
    Changed {
        /// What it had before.
        before: Config,
        /// What it has now.
        now: Config,
    },
}

/// Why a configuration is not in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unconfigured {
    /// The board's firmware finds it out of range or at odds with itself.
    Refused,
    /// The board's firmware does not know the command.
    NotUnderstood,
    /// The board speaks other messages than this program: it might take what it is told for something else.
    OtherSchema,
    /// No answer came.
    NoAnswer {
        /// How often the board was asked.
        tries: u8,
    },
    /// The device cannot be written to.
    Mute,
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Board { firmware, board, schema } => {
                write!(f, "recording {firmware} on {board}")?;
                if *schema == schema::HASH {
                    return Ok(());
                }
                let ours = schema::HASH;
                write!(
                    f,
                    "; it speaks message schema {schema:016x}, this program knows {ours:016x}: logged all the same"
                )
            }
            Self::Restarted { why } if why.is_empty() => f.write_str("the board has restarted"),
            Self::Restarted { why } => write!(f, "the board has restarted: {why}"),
            Self::Gone { why } => write!(f, "connection lost ({why}), trying again"),
            Self::Back => f.write_str("connected again"),
            Self::Silent => write!(f, "nothing comes from the board for {} s", SILENCE.as_secs()),
            Self::Overflow { bytes } => write!(f, "the log is too slow: {bytes} bytes lost"),
            Self::LastFile => {
                write!(f, "no number up to {PARTS} is free for another file: this one grows on, whatever its size")
            }
            Self::NoNextFile { why } => {
                write!(
                    f,
                    "{why}: no other file can begin, so this one grows on, whatever its size; tried again every minute"
                )
            }
            Self::NextFile => f.write_str("another file could be made: the recording goes on in it"),
            Self::Mute { why } => write!(f, "nothing can be said to the board ({why}): recorded as it comes"),
            Self::InForce { config, again, profiles } => {
                let what = if *again { "configuration sent again and in force" } else { "configuration in force" };
                write!(f, "{what}: {}", gist(config))?;
                match profiles {
                    0 => Ok(()),
                    1 => f.write_str("; the profile before was measured with another"),
                    _ => write!(f, "; the {profiles} profiles before were measured with another"),
                }
            }
            Self::Unconfigured { why, echoed } => {
                write!(f, "the configuration is not in force: {why}")?;
                match echoed {
                    Some(config) => write!(f, "; its last word was that it measures with {}", gist(config)),
                    None => f.write_str("; what it measures with is not known"),
                }
            }
            Self::Changed { before, now } => {
                let what = if *now == Config::default() { "the default" } else { "another" };
                write!(f, "the board now measures with {what} configuration: {}", changes(before, now))
            }
        }
    }
}

impl fmt::Display for Unconfigured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused => f.write_str("the board refuses it as out of range or at odds with itself"),
            Self::NotUnderstood => f.write_str("the board's firmware does not understand it"),
            Self::OtherSchema => f.write_str("the board speaks other messages than this program, so it was not sent"),
            Self::NoAnswer { tries } => write!(f, "the board was asked {tries} times and has not answered"),
            Self::Mute => f.write_str("the device cannot be written to"),
        }
    }
}

/// What calibration finds, which no default has.
pub(crate) fn gist(config: &Config) -> String {
    if *config == Config::default() {
        return "the defaults (mounting offset 0 degrees, delay 0 ms)".to_owned();
    }
    format!("mounting offset {:+.4} degrees, delay {:+.3} ms", offset(config), delay(config))
}

fn offset(config: &Config) -> f64 {
    degrees(config.scanner.mounting_offset)
}

fn delay(config: &Config) -> f64 {
    f64::from(config.scanner.delay_us) / 1e3
}

/// The mounting offset in any case, since every slope is off by the whole of it; the delay where it has changed; how much else has.
fn changes(before: &Config, now: &Config) -> String {
    let mut told = format!("mounting offset was {:+.4} degrees, now {:+.4} degrees", offset(before), offset(now));
    let mut named = *now;
    named.scanner.mounting_offset = before.scanner.mounting_offset;
    if before.scanner.delay_us != now.scanner.delay_us {
        told += &format!("; delay was {:+.3} ms, now {:+.3} ms", delay(before), delay(now));
        named.scanner.delay_us = before.scanner.delay_us;
    }
    // Both have the same keys in the same lines.
    let others = to_toml(before).lines().zip(to_toml(&named).lines()).filter(|(before, now)| before != now).count();
    match others {
        0 => {}
        1 => told += "; one other value differs",
        _ => told += &format!("; {others} other values differ"),
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::angle_of;
    use crossfall_core::protocol::config::Method;

    #[test]
    fn what_has_changed_is_told_with_the_offset_first() {
        let mut before = Config::default();
        before.scanner.mounting_offset = angle_of(0.8079);
        let told = |before, now| Notice::Changed { before, now }.to_string();
        assert_eq!(
            told(before, Config::default()),
            "the board now measures with the default configuration: mounting offset was +0.8079 degrees, now +0.0000 degrees"
        );
        before.scanner.delay_us = 1_465;
        before.survey.method = Method::Seed;
        before.ins.lever_arm_mm = [1, 2, 3];
        assert_eq!(
            told(Config::default(), before),
            "the board now measures with another configuration: mounting offset was +0.0000 degrees, now +0.8079 degrees; \
             delay was +0.000 ms, now +1.465 ms; 2 other values differ"
        );
    }

    #[test]
    fn every_notice_is_one_line() {
        let config = Config::default();
        let why = [
            Unconfigured::Refused,
            Unconfigured::NotUnderstood,
            Unconfigured::OtherSchema,
            Unconfigured::NoAnswer { tries: 3 },
            Unconfigured::Mute,
        ];
        let unconfigured = why.map(|why| Notice::Unconfigured { why, echoed: Some(config) });
        let in_force = [0, 1, 2].map(|profiles| Notice::InForce { config, again: profiles > 0, profiles });
        for notice in unconfigured.iter().chain(&in_force) {
            let line = notice.to_string();
            assert!(!line.contains('\n') && line.contains("mounting offset 0 degrees"), "{line}");
        }
    }
}
