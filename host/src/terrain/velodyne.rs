//! Data packets of the Velodyne VLP-16 and HDL-32E: 1,206 bytes of UDP payload to points.
//!
//! A packet has twelve blocks of 100 bytes (flag FF EE, azimuth in hundredths of a degree, 32 returns of a distance in 2 mm and a
//! reflectivity), the microsecond within the hour, the return mode and the model. A block of the VLP-16 holds two firings of its 16 lasers, one of
//! the HDL-32E one firing of its 32. The head turns on while a firing lasts, so every return gets the azimuth of its own instant, between its
//! block's and the next one's. Angles, heights and times are those of the two user manuals (VLP-16: 63-9243, chapters 9 and "sensor
//! specifications"; HDL-32E: 63-9113).
//!
//! Axes: x forward (azimuth 0), y left, z up. In the dual mode the last returns are used; they lie behind dust and rain.

/// Bytes of a data packet.
pub const PACKET: usize = 1206;
const BLOCKS: usize = 12;
const BLOCK: usize = 100;
/// Metres a unit of distance.
const UNIT_M: f64 = 0.002;

/// The sensor that a packet is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// HDL-32E.
    Hdl32,
    /// VLP-16 (Puck).
    Vlp16,
}

impl Model {
    /// The product id at the end of a packet.
    fn of(id: u8) -> Option<Self> {
        match id {
            0x21 => Some(Self::Hdl32),
            0x22 => Some(Self::Vlp16),
            _ => None,
        }
    }

    /// Lasers, which are the returns of one firing.
    fn lasers(self) -> usize {
        match self {
            Self::Hdl32 => 32,
            Self::Vlp16 => 16,
        }
    }

    /// Microseconds from laser to laser, and from firing to firing.
    fn times_us(self) -> (f64, f64) {
        match self {
            Self::Hdl32 => (1.152, 46.080),
            Self::Vlp16 => (2.304, 55.296),
        }
    }

    /// Elevation of a laser in degrees, and the height of its exit above the optical centre in metres.
    fn laser(self, index: usize) -> (f64, f64) {
        let (pair, odd) = ((index / 2) as f64, index % 2 == 1);
        match self {
            // Even lasers rise from -30.67 degrees, odd ones from -9.33, both by 1.33 = 4/3.
            Self::Hdl32 => ((if odd { -28.0 } else { -92.0 } + 4.0 * pair) / 3.0, 0.0),
            // Even lasers rise from -15 degrees, odd ones from 1; their exits lie up to 11.2 mm off the centre.
            Self::Vlp16 => {
                const EXITS_MM: [f64; 16] =
                    [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2];
                (if odd { 1.0 } else { -15.0 } + 2.0 * pair, EXITS_MM[index & 15] * 1e-3)
            }
        }
    }
}

/// Why a payload is no data packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Not 1,206 bytes.
    Size,
    /// A block does not begin with FF EE: damaged, or of a sensor with other blocks.
    Flag,
    /// An azimuth of 360 degrees or more.
    Azimuth,
    /// Neither a VLP-16 nor an HDL-32E.
    Model(u8),
}

/// A point of a packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Return {
    /// x forward, y left, z up, m; reflectivity 0 to 1.
    pub point: [f32; 4],
    /// Degrees clockwise from forward, 0 to 360.
    pub azimuth_deg: f64,
    /// Microseconds since the packet's first firing.
    pub after_us: f64,
}

/// Decodes a packet; returns without an echo are left out.
///
/// # Errors
/// What is no data packet of these sensors.
pub fn decode(payload: &[u8], mut put: impl FnMut(Return)) -> Result<Model, Refusal> {
    if payload.len() != PACKET {
        return Err(Refusal::Size);
    }
    let (mode, id) = (payload[PACKET - 2], payload[PACKET - 1]);
    let model = Model::of(id).ok_or(Refusal::Model(id))?;
    let mut azimuths = [0.0; BLOCKS];
    for (azimuth, block) in azimuths.iter_mut().zip(payload.as_chunks::<BLOCK>().0) {
        if block[..2] != [0xFF, 0xEE] {
            return Err(Refusal::Flag);
        }
        let hundredths = u16::from_le_bytes([block[2], block[3]]);
        if hundredths >= 36_000 {
            return Err(Refusal::Azimuth);
        }
        *azimuth = f64::from(hundredths) * 0.01;
    }
    // In the dual mode blocks come in pairs of one azimuth: the last return, then the strongest.
    let stride = if mode == 0x39 { 2 } else { 1 };
    let (lasers, (laser_us, firing_us)) = (model.lasers(), model.times_us());
    let firings = 32 / lasers;
    let block_us = firings as f64 * firing_us;
    let turned = |from: f64, to: f64| (to - from).rem_euclid(360.0);
    for (order, index) in (0..BLOCKS).step_by(stride).enumerate() {
        // The last block goes on as the one before it. A jump of more than two degrees is a gap and not the head's turning.
        let pair = if index + stride < BLOCKS { [index, index + stride] } else { [index - stride, index] };
        let step = turned(azimuths[pair[0]], azimuths[pair[1]]);
        let step = if step < 2.0 { step } else { 0.0 };
        let block = &payload[index * BLOCK + 4..(index + 1) * BLOCK];
        for (slot, value) in block.as_chunks::<3>().0.iter().enumerate() {
            let distance = u16::from_le_bytes([value[0], value[1]]);
            if distance == 0 {
                continue;
            }
            let (firing, laser) = (slot / lasers, slot % lasers);
            let within_us = firing as f64 * firing_us + laser as f64 * laser_us;
            let azimuth_deg = (azimuths[index] + step * within_us / block_us).rem_euclid(360.0);
            let (elevation, up) = model.laser(laser);
            let range = f64::from(distance) * UNIT_M;
            let (sin, cos) = azimuth_deg.to_radians().sin_cos();
            let (rise, flat) = elevation.to_radians().sin_cos();
            let point = [range * flat * cos, -range * flat * sin, range * rise + up].map(|value| value as f32);
            put(Return {
                point: [point[0], point[1], point[2], f32::from(value[2]) / 255.0],
                azimuth_deg,
                after_us: order as f64 * block_us + within_us,
            });
        }
    }
    Ok(model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lasers_lie_where_the_manuals_say() {
        let elevations = |model: Model| -> Vec<f64> { (0..model.lasers()).map(|laser| model.laser(laser).0).collect() };
        let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.005);
        let hdl = [-30.67, -9.33, -29.33, -8.0, -28.0, -6.67, -26.67, -5.33, -25.33, -4.0, -24.0, -2.67, -22.67, -1.33];
        let end = [-12.0, 9.33, -10.67, 10.67];
        let of_hdl = elevations(Model::Hdl32);
        assert!(near(&of_hdl, &hdl) && near(&of_hdl[28..], &end), "{of_hdl:?}");
        let vlp = [-15.0, 1.0, -13.0, 3.0, -11.0, 5.0, -9.0, 7.0, -7.0, 9.0, -5.0, 11.0, -3.0, 13.0, -1.0, 15.0];
        assert!(near(&elevations(Model::Vlp16), &vlp));
    }
}
