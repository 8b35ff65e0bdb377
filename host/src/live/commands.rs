//! What is said to the board, and who waits for its answer; what viewers may ask for.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::{Command, Label, Outcome, Reply, Sensor};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::oneshot;

use super::Live;
use super::drive_name::DriveName;
use super::player::MAX_SPEED;
use super::session::{Order, RockOrder};
use crate::config;
use crate::record::{ANSWER, Outbox};

/// Commands that may wait for their answers.
const WAITING: usize = 32;

/// The way to the board.
#[derive(Debug, Default)]
pub struct Commands {
    outbox: Outbox,
    /// Who waits for an answer, by the number of the command.
    asked: Mutex<BTreeMap<u16, oneshot::Sender<Outcome>>>,
}

impl Commands {
    /// What the port's thread is to write.
    pub fn outbox(&self) -> &Outbox {
        &self.outbox
    }

    /// Says something to the board.
    pub fn send(&self, command: &Command) {
        let _unheard = self.outbox.say(command);
    }

    /// Says something to the board; the answer comes through the channel, if one comes.
    pub fn ask(&self, command: &Command) -> oneshot::Receiver<Outcome> {
        let (answer, answered) = oneshot::channel();
        // Held while it is said: the answer must find who waits for it.
        let mut asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(number) = self.outbox.say(command) {
            if asked.len() == WAITING {
                asked.pop_first();
            }
            asked.insert(number, answer);
        }
        answered
    }

    /// The board has answered.
    pub fn answered(&self, reply: Reply) {
        let mut asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(asker) = asked.remove(&reply.to) {
            // Who no longer waits needs no answer.
            let _gone = asker.send(reply.outcome);
        }
    }
}

/// Why something that was asked for is not done, in words for the operator.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// It cannot be asked for like this.
    #[error("{0}")]
    Invalid(String),
    /// It cannot be done now.
    #[error("{0}")]
    Conflict(String),
    /// The board did not do it.
    #[error("{0}")]
    Board(String),
}

/// What a viewer may ask for.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Record a drive.
    Record {
        /// Its name; the time where there is none.
        #[serde(default)]
        name: String,
    },
    /// End the recording. With braces, as [`Request::ApplyRockTest`], for serde to refuse what does not belong here.
    Stop {},
    /// Drop a marker.
    Mark {
        /// Its name, at most 24 bytes.
        #[serde(default)]
        label: String,
    },
    /// Put a configuration in force.
    Configure {
        /// As `crossfall config` prints it; what is left out has its default.
        toml: String,
    },
    /// Bring a sensor up again.
    Restart {
        /// Which.
        sensor: SensorName,
    },
    /// Wind a replay.
    Seek {
        /// Seconds from its start.
        seconds: f64,
    },
    /// Change a replay's speed.
    Speed {
        /// Times real time.
        times: f64,
    },
    /// Halt a replay, or let it go on.
    Pause {
        /// Whether it is to stand still.
        paused: bool,
    },
    /// Begin, end or give up a rock test.
    RockTest {
        /// Which.
        action: RockOrder,
    },
    /// Put in force what the rock test could tell: offset, delay or both.
    ApplyRockTest {},
}

impl Request {
    /// What a viewer wrote. From a [`serde_json::Value`] and not from text: `serde_json` hands fractions of a text to a tagged enum in a form that no `f64`
    /// takes, wherever a crate of the build enables its `arbitrary_precision`.
    ///
    /// # Errors
    /// When it is none of the requests, or has a field too many or too few.
    pub fn from_json(value: Value) -> Result<Self, serde_json::Error> {
        Self::deserialize(value)
    }
}

/// A sensor by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorName {
    /// The scanner.
    Lidar,
    /// The inertial unit.
    Ins,
}

impl Live {
    /// Does what was asked for, and says what came of it.
    ///
    /// # Errors
    /// [`Refusal`], in words for the operator.
    pub async fn execute(&self, request: Request) -> Result<Value, Refusal> {
        match request {
            Request::Record { name } => {
                let name = DriveName::new(&name).map_err(Refusal::Invalid)?;
                let (tell, told) = oneshot::channel();
                self.order(Order::Record { name, tell });
                let file = within(told).await?.map_err(Refusal::Conflict)?;
                Ok(json!({ "file": file }))
            }
            Request::Stop {} => {
                let (tell, told) = oneshot::channel();
                self.order(Order::Stop { tell: Some(tell) });
                within(told).await?.map_err(Refusal::Conflict)?;
                Ok(json!({}))
            }
            Request::Mark { label } => {
                if label.len() > Label::MAX || label.chars().any(char::is_control) {
                    return Err(Refusal::Invalid(format!("a marker's name has at most {} bytes", Label::MAX)));
                }
                self.tell(&Command::Mark(Label::new(&label))).await
            }
            Request::Configure { toml } => {
                let config = config::parse(Path::new("configuration"), &toml)
                    .map_err(|error| Refusal::Invalid(error.to_string()))?;
                self.configure(config).await
            }
            Request::Restart { sensor } => {
                let sensor = match sensor {
                    SensorName::Lidar => Sensor::Lidar,
                    SensorName::Ins => Sensor::Ins,
                };
                self.tell(&Command::Restart(sensor)).await
            }
            Request::Seek { seconds } => {
                let finite = seconds.is_finite() && seconds >= 0.0;
                if !finite {
                    return Err(Refusal::Invalid("a place is a number of seconds, 0 or more".into()));
                }
                self.may_wind()?;
                self.replay(|transport| transport.wind_to_s = Some(seconds))
            }
            Request::Speed { times } => {
                if !(0.1..=MAX_SPEED).contains(&times) {
                    return Err(Refusal::Invalid(format!("a speed is a number from 0.1 to {MAX_SPEED}")));
                }
                self.replay(|transport| transport.speed = times)
            }
            Request::Pause { paused } => self.pause(paused),
            Request::RockTest { action } => {
                self.rock(action);
                Ok(json!({}))
            }
            Request::ApplyRockTest {} => {
                let state = self.hub().state();
                let estimate = state.rock_test.as_ref().and_then(|test| test.estimate.as_ref());
                let (Some(estimate), Some(mut config)) = (estimate, self.hub().config()) else {
                    return Err(Refusal::Conflict("there is no result to put in force".into()));
                };
                if !(estimate.offset_determined || estimate.delay_determined) {
                    let words = "the test can tell neither offset nor delay: the old ones stay";
                    return Err(Refusal::Conflict(words.into()));
                }
                config.scanner =
                    estimate.scanner(&config.scanner).map_err(|refusal| Refusal::Conflict(refusal.to_string()))?;
                self.configure(config).await
            }
        }
    }

    /// Says something to the board and waits for its answer.
    async fn tell(&self, command: &Command) -> Result<Value, Refusal> {
        match within(self.commands().ask(command)).await? {
            Outcome::Done | Outcome::Pong(_) => Ok(json!({})),
            Outcome::BadConfig => Err(Refusal::Board("the board refuses this configuration; the old one stays".into())),
            Outcome::Unknown => Err(Refusal::Board("the board cannot do this".into())),
        }
    }

    /// Puts a configuration in force and waits for the board's echo.
    async fn configure(&self, config: Config) -> Result<Value, Refusal> {
        if let Err(error) = config.check() {
            return Err(Refusal::Invalid(error.to_string()));
        }
        self.tell(&Command::Configure(config)).await?;
        // The echo goes before the answer, but through the model's queue.
        for _ in 0..40 {
            if self.hub().config() == Some(config) {
                return Ok(json!({ "toml": config::to_toml(&config) }));
            }
            tokio::time::sleep(Duration::from_millis(25)).await;
        }
        Err(Refusal::Board("the board has not echoed this configuration".into()))
    }

    /// Halts a replay, or lets it go on: from its end it begins again.
    ///
    /// # Errors
    /// Where there is none, or it would begin again within a recording.
    pub(super) fn pause(&self, paused: bool) -> Result<Value, Refusal> {
        let again = !paused && self.controls().is_some_and(|controls| controls.lock().ended);
        if again {
            self.may_wind()?;
        }
        self.replay(|transport| {
            transport.paused = paused;
            if again {
                transport.wind_to_s = Some(0.0);
            }
        })
    }

    fn may_wind(&self) -> Result<(), Refusal> {
        if self.hub().state().recording.phase == super::Phase::Idle {
            return Ok(());
        }
        Err(Refusal::Conflict("end the recording first: a log cannot jump in time".into()))
    }

    fn replay(&self, change: impl FnOnce(&mut super::player::Transport)) -> Result<Value, Refusal> {
        let Some(controls) = self.controls() else {
            return Err(Refusal::Conflict("this is no replay but a board".into()));
        };
        change(&mut controls.lock());
        Ok(json!({}))
    }
}

/// An answer, if it comes in time.
async fn within<T>(answer: oneshot::Receiver<T>) -> Result<T, Refusal> {
    match tokio::time::timeout(ANSWER, answer).await {
        Ok(Ok(answer)) => Ok(answer),
        _ => Err(Refusal::Board("no answer from the board: is it connected?".into())),
    }
}
