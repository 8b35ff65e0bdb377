//! From a scene to the rows of its log, through files and the board's own code as for any drive.

use std::path::PathBuf;

use crossfall_core::protocol::Config;
use crossfall_core::protocol::config::Method;
use tempfile::TempDir;

use super::Error;
use crate::compare::Drive;
use crate::simulate::scene::Scene;
use crate::simulate::{self, Summary};
use crate::{capture, interrupt, log, run};

/// Where experiments are done: a folder that goes away, and the seed of everything random.
pub struct Bench {
    folder: TempDir,
    pub seed: u64,
    longest_s: f64,
}

/// A drive as it left the vehicle.
pub struct Captured {
    pub path: PathBuf,
    pub made: Summary,
}

/// Which search runs.
pub const BOTH_METHODS: [Method; 2] = [Method::Measuring, Method::Seed];

impl Bench {
    pub fn new(seed: u64, longest_s: f64) -> Result<Self, Error> {
        Ok(Self { folder: tempfile::tempdir()?, seed, longest_s })
    }

    /// How long a drive of so many seconds is to be here.
    pub fn seconds(&self, seconds: f64) -> f64 {
        seconds.min(self.longest_s)
    }

    /// A file of this bench.
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Simulates a drive.
    pub fn drive(&self, name: &str, scene: &Scene) -> Result<Captured, Error> {
        let path = self.file(&format!("{name}.mcap"));
        let mut writer = capture::Writer::create(&path)?;
        let made = simulate::simulate(scene, &mut writer, |_| ())?;
        writer.finish()?;
        Ok(Captured { path, made })
    }

    /// Puts a capture through the board's code; the path of its log.
    pub fn log(&self, name: &str, captured: &Captured, config: &Config) -> Result<PathBuf, Error> {
        let path = self.file(&format!("{name}.log.mcap"));
        let mut reader = capture::Reader::open(&captured.path)?;
        let mut writer = log::Writer::create(&path)?;
        run::run(&mut reader, config, &mut writer, |_| ())?;
        writer.finish()?;
        if interrupt::requested() {
            return Err(Error::Interrupted);
        }
        Ok(path)
    }

    /// The profiles of a capture by one of the searches.
    pub fn profiles(&self, name: &str, captured: &Captured, method: Method) -> Result<Drive, Error> {
        let mut config = Config::default();
        config.survey.method = method;
        let log = self.log(name, captured, &config)?;
        Ok(Drive { name: name.to_owned(), ..Drive::read(&log)? })
    }
}
