//! An LMS 2xx as the other end of its line sees it: answers the bring-up dialogue and sends scans.
//!
//! Follows the telegram listing as far as the bring-up uses it: baud changes (the answer at the old rate), operating
//! modes with the installation password, variant, status and configuration, the power-on message after a restart. What
//! it hears at another rate than its own is noise to it. It holds no clock; its caller decides when it speaks.

use crossfall_core::sensors::lms2xx::crc;

const STX: u8 = 0x02;
const ACK: u8 = 0x06;
const NAK: u8 = 0x15;

/// Replies come from this address.
const ADDRESS: u8 = 0x80;

/// Status byte of a sound scanner: bits 3 and 4 are 10b.
const SOUND: u8 = 0x10;

/// Offsets into the data of a status report (B1h).
const REPORT_LENGTH: usize = 152;

/// What the scanner does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Waits for commands.
    OnRequest,
    /// Sends every scan.
    Continuous,
    /// Accepts a new configuration.
    Installation,
}

/// Bytes that the scanner sends, and the rate it sends them at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Rate of the line.
    pub baud: u32,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// One scanner.
#[derive(Clone, Debug)]
pub struct Scanner {
    /// The rate of its line.
    pub baud: u32,
    /// What it does.
    pub mode: Mode,
    /// Angle in degrees and step in hundredths.
    pub variant: (u8, u8),
    /// Its stored configuration.
    pub configuration: [u8; 34],
    /// A scanner without power, or whose cable is out, neither hears nor speaks.
    pub silent: bool,
    /// Command bytes of the telegrams that it has understood, in order.
    pub understood: Vec<Vec<u8>>,
    /// Refuse so many commands with a NAK before understanding the next.
    pub refusals: u32,
    /// Acknowledge the start of the output, and report it done only when told to ([`Scanner::begin`]): a change of mode may take 3 s, and a
    /// board that has been told of one misses scans that do not follow at once.
    pub holds_start: bool,
    held: Option<Answer>,
    power_on_baud: u32,
    heard: Vec<u8>,
    indices: [u8; 2],
}

impl Scanner {
    /// A scanner that has been on for a while, waiting for commands at this rate, in its factory configuration: centimetres,
    /// 8 m, no indices, one degree.
    #[must_use]
    pub fn waiting_at(baud: u32) -> Self {
        let mut configuration = [0; 34];
        // Blanking, thresholds, availability, measuring mode, unit (the rest is evaluation, which nobody reads here).
        configuration[..7].copy_from_slice(&[0, 0, 70, 0, 0, 0, 0]);
        Self {
            baud,
            mode: Mode::OnRequest,
            variant: (180, 100),
            configuration,
            silent: false,
            understood: Vec::new(),
            refusals: 0,
            holds_start: false,
            held: None,
            power_on_baud: 9_600,
            heard: Vec::new(),
            indices: [0; 2],
        }
    }

    /// Power off and on: the rate and mode of its power-on, and its message. The stored configuration stays.
    pub fn restart(&mut self) -> Answer {
        self.baud = self.power_on_baud;
        self.mode = Mode::OnRequest;
        self.variant = (180, 100);
        self.heard.clear();
        self.held = None;
        self.indices = [0; 2];
        Answer { baud: self.baud, bytes: reply(0x90, b"LMS291;30106;V02.30 ") }
    }

    /// Bytes from the host at `baud`; what the scanner says to them, in order.
    pub fn hear(&mut self, bytes: &[u8], baud: u32) -> Vec<Answer> {
        if self.silent || baud != self.baud {
            self.heard.clear();
            return Vec::new();
        }
        self.heard.extend_from_slice(bytes);
        let mut answers = Vec::new();
        while let Some(command) = self.next_command() {
            answers.extend(self.obey(&command));
        }
        answers
    }

    /// The answer to the start of the output that was held back, if one was.
    pub fn begin(&mut self) -> Option<Answer> {
        self.held.take()
    }

    /// Whether its scans reach the line.
    #[must_use]
    pub fn is_sending(&self) -> bool {
        !self.silent && self.mode == Mode::Continuous
    }

    /// The telegram of one scan, when the scanner is sending scans: 361 or 181 values and, if enabled, its indices.
    pub fn scan(&mut self, values: &[u16]) -> Option<Answer> {
        if !self.is_sending() {
            return None;
        }
        let count = 1 + usize::from(self.variant.0) * 100 / usize::from(self.variant.1);
        let unit = u16::from(self.configuration[6] == 1) << 14;
        let mut data = (unit | count as u16).to_le_bytes().to_vec();
        data.extend(values.iter().copied().chain(std::iter::repeat(0)).take(count).flat_map(u16::to_le_bytes));
        if self.sends_indices() {
            data.extend(self.indices);
        }
        self.skip_scan();
        Some(Answer { baud: self.baud, bytes: reply(0xb0, &data) })
    }

    /// A scan that is measured and counted, but never reaches the line.
    pub fn skip_scan(&mut self) {
        let turns = (100 / self.variant.1).max(1);
        self.indices = [self.indices[0].wrapping_add(turns), self.indices[1].wrapping_add(1)];
    }

    /// Whether its configuration adds indices to scans.
    #[must_use]
    pub fn sends_indices(&self) -> bool {
        self.configuration[4] & 0x02 != 0
    }

    /// Takes the next whole telegram off what was heard; its command and data.
    fn next_command(&mut self) -> Option<Vec<u8>> {
        loop {
            let start = self.heard.iter().position(|&byte| byte == STX).unwrap_or(self.heard.len());
            self.heard.drain(..start);
            let length = usize::from(u16::from_le_bytes([*self.heard.get(2)?, *self.heard.get(3)?]));
            if length > 1_000 {
                self.heard.remove(0);
                continue;
            }
            let end = 4 + length;
            let check = [*self.heard.get(end)?, *self.heard.get(end + 1)?];
            if crc(&self.heard[..end]).to_le_bytes() != check {
                self.heard.remove(0);
                continue;
            }
            let command = self.heard[4..end].to_vec();
            self.heard.drain(..end + 2);
            return Some(command);
        }
    }

    fn obey(&mut self, command: &[u8]) -> Vec<Answer> {
        let baud = self.baud;
        let answer = |bytes: Vec<u8>| Answer { baud, bytes };
        if self.refusals > 0 {
            self.refusals -= 1;
            return vec![answer(vec![NAK])];
        }
        // While it sends scans, the scanner understands a change of mode and little else (TL, section 7).
        let changes_mode = command.first() == Some(&0x20);
        if self.mode == Mode::Continuous && !changes_mode {
            return vec![answer(vec![NAK])];
        }
        self.understood.push(command.to_vec());
        let mut answers = vec![answer(vec![ACK])];
        let body = match *command {
            [0x31] => reply(0xb1, &self.report()),
            [0x3a] => reply(0xba, b"LMS291;30106;V02.30 "),
            [0x74] => reply(0xf4, &self.configuration),
            [0x77, ref data @ ..] if self.mode == Mode::Installation && data.len() == 34 => {
                self.configuration.copy_from_slice(data);
                reply(0xf7, &[&[1], data].concat())
            }
            [0x3b, span, 0, step, 0] if matches!((span, step), (180, 50 | 100) | (100, 25 | 50 | 100)) => {
                self.variant = (span, step);
                reply(0xbb, &[1, span, 0, step, 0])
            }
            [0x20, 0x00, ref password @ ..] if password == b"SICK_LMS" => self.change_mode(Mode::Installation),
            [0x20, 0x00, ..] => reply(0xa0, &[1]),
            [0x20, 0x24] => self.change_mode(Mode::Continuous),
            [0x20, 0x25] => self.change_mode(Mode::OnRequest),
            [0x20, mode @ (0x40..=0x42 | 0x48)] => {
                self.baud = match mode {
                    0x48 => 500_000,
                    0x40 => 38_400,
                    0x41 => 19_200,
                    _ => 9_600,
                };
                reply(0xa0, &[0])
            }
            _ => reply(0x92, &[]),
        };
        let answer = answer(body);
        if self.holds_start && command == [0x20, 0x24] {
            self.held = Some(answer);
        } else {
            answers.push(answer);
        }
        answers
    }

    fn change_mode(&mut self, mode: Mode) -> Vec<u8> {
        self.mode = mode;
        reply(0xa0, &[0])
    }

    fn report(&self) -> [u8; REPORT_LENGTH] {
        let mut report = [0; REPORT_LENGTH];
        report[..7].copy_from_slice(b"V02.30 ");
        report[7] = match self.mode {
            Mode::OnRequest => 0x25,
            Mode::Continuous => 0x24,
            Mode::Installation => 0x00,
        };
        report[66..68].copy_from_slice(&148u16.to_le_bytes());
        report[101] = self.configuration[5];
        report[106..108].copy_from_slice(&u16::from(self.variant.0).to_le_bytes());
        report[108..110].copy_from_slice(&u16::from(self.variant.1).to_le_bytes());
        let divider: u16 = match self.baud {
            500_000 => 0x8001,
            38_400 => 0x8019,
            19_200 => 0x8033,
            _ => 0x8067,
        };
        report[115..117].copy_from_slice(&divider.to_le_bytes());
        report[119] = ADDRESS;
        report[121] = self.configuration[6];
        report
    }
}

/// A telegram from the scanner.
#[must_use]
pub fn reply(command: u8, data: &[u8]) -> Vec<u8> {
    let length = data.len() as u16 + 2;
    let mut telegram = vec![STX, ADDRESS];
    telegram.extend(length.to_le_bytes());
    telegram.push(command);
    telegram.extend_from_slice(data);
    telegram.push(SOUND);
    let check = crc(&telegram);
    telegram.extend(check.to_le_bytes());
    telegram
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The start of continuous output, as the listing has it.
    const START: [u8; 8] = [0x02, 0, 0x02, 0, 0x20, 0x24, 0x34, 0x08];
    const TO_500K: [u8; 8] = [0x02, 0, 0x02, 0, 0x20, 0x48, 0x58, 0x08];
    /// "Mode change done", as the listing has it.
    const DONE: [u8; 9] = [0x02, 0x80, 0x03, 0, 0xa0, 0, 0x10, 0x16, 0x0a];

    #[test]
    fn answers_as_in_the_listing() {
        let mut scanner = Scanner::waiting_at(9_600);
        let answers = scanner.hear(&START, 9_600);
        assert_eq!(answers, [Answer { baud: 9_600, bytes: vec![ACK] }, Answer { baud: 9_600, bytes: DONE.to_vec() }]);
        assert_eq!(scanner.mode, Mode::Continuous);
    }

    #[test]
    fn the_new_rate_holds_after_the_answer() {
        let mut scanner = Scanner::waiting_at(9_600);
        let answers = scanner.hear(&TO_500K, 9_600);
        assert!(answers.iter().all(|answer| answer.baud == 9_600));
        assert_eq!(scanner.baud, 500_000);
        assert!(scanner.hear(&START, 9_600).is_empty(), "noise at the old rate");
        assert_eq!(scanner.hear(&START, 500_000).len(), 2);
    }

    #[test]
    fn a_start_that_is_held_is_answered_when_the_scans_come() {
        let mut scanner = Scanner::waiting_at(500_000);
        scanner.holds_start = true;
        assert_eq!(scanner.hear(&START, 500_000), [Answer { baud: 500_000, bytes: vec![ACK] }]);
        assert_eq!(scanner.begin(), Some(Answer { baud: 500_000, bytes: DONE.to_vec() }));
        assert_eq!((scanner.begin(), scanner.is_sending()), (None, true));
    }

    #[test]
    fn a_scan_is_722_or_732_bytes_and_counts_itself() {
        let mut scanner = Scanner::waiting_at(500_000);
        scanner.variant = (180, 50);
        assert!(scanner.scan(&[]).is_none(), "not sending yet");
        scanner.hear(&START, 500_000);
        assert_eq!(scanner.scan(&[8_000; 361]).expect("sending").bytes.len(), 732);
        scanner.configuration[4] |= 2;
        let telegram = scanner.scan(&[8_000; 361]).expect("sending").bytes;
        assert_eq!(telegram.len(), 734);
        assert_eq!(telegram[729..731], [2, 1], "two turns and one telegram further");
    }
}
