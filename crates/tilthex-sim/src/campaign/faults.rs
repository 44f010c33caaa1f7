//! What can go wrong in a campaign's flight, and how it is done to the simulated world.

use tilthex_core::{
    Vector3,
    plant::{SensorParams, Sensors},
    random::Random,
    so3,
    types::PoseSample,
};

use crate::Simulation;

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[allow(missing_docs)] // each is described by its text
pub enum Kind {
    BitFlips,
    FramesLost,
    FramesDuplicated,
    FramesReordered,
    FramesCut,
    Garbage,
    CaptureLost,
    CaptureFlips,
    CaptureJumps,
    CaptureNoise,
    CaptureClock,
    ImuNoise,
    ImuFrozen,
    GyroBias,
    AccelerometerBias,
    ImuSaturated,
    RotorThrust,
    RotorSlow,
    RotorStuck,
    MotorEmergency,
    BatteryEmpty,
    Reboot,
    Unplugged,
    DiskFull,
    DiskSlow,
    Stopped,
    CommandsLost,
}

impl Kind {
    /// Every kind, with what it does.
    pub const ALL: [(Self, &str); 27] = [
        (Self::BitFlips, "a bit of a byte in 20 to 2000 flipped, both ways"),
        (Self::FramesLost, "5 to 100 % of the vehicle's frames lost"),
        (Self::FramesDuplicated, "5 to 100 % of the vehicle's frames twice"),
        (Self::FramesReordered, "the vehicle's frames of a tick in another order"),
        (Self::FramesCut, "5 to 100 % of the vehicle's frames cut short"),
        (Self::Garbage, "bursts of up to 300 random bytes"),
        (Self::CaptureLost, "no pose for up to 3 s"),
        (Self::CaptureFlips, "poses turned by 180 deg"),
        (Self::CaptureJumps, "poses displaced by 0.05 to 2 m"),
        (Self::CaptureNoise, "poses 5 to 100 times as noisy"),
        (Self::CaptureClock, "capture times off by up to 1 s either way"),
        (Self::ImuNoise, "inertial noise 3 to 30 times as large"),
        (Self::ImuFrozen, "the same inertial sample again and again"),
        (Self::GyroBias, "a step of the gyroscope's bias up to 0.2 rad/s"),
        (Self::AccelerometerBias, "a step of the accelerometer's bias up to 1 m/s^2"),
        (Self::ImuSaturated, "the gyroscope at the end of its range"),
        (Self::RotorThrust, "a rotor with 0 to 80 % of its thrust"),
        (Self::RotorSlow, "a rotor at 40 to 90 % of the speed asked for"),
        (Self::RotorStuck, "a rotor that stands still"),
        (Self::MotorEmergency, "a motor that stops and shows its emergency bit"),
        (Self::BatteryEmpty, "a battery that is suddenly almost empty"),
        (Self::Reboot, "the flight board restarts"),
        (Self::Unplugged, "the port goes away"),
        (Self::DiskFull, "the log can not be written"),
        (Self::DiskSlow, "the log's disk stands still"),
        (Self::Stopped, "the program is stopped for 5 to 500 ms"),
        (Self::CommandsLost, "no command reaches the vehicle"),
    ];

    /// What it does.
    #[must_use]
    pub fn text(self) -> &'static str {
        Self::ALL.iter().find(|(kind, _)| *kind == self).map_or("", |(_, text)| text)
    }

    /// Whether the vehicle can no longer be expected to carry itself: then it
    /// may come down hard and aside, and still no motor is stopped in the air.
    #[must_use]
    pub fn takes_lift(self) -> bool {
        matches!(
            self,
            Self::RotorThrust
                | Self::RotorSlow
                | Self::RotorStuck
                | Self::MotorEmergency
                | Self::Unplugged
                | Self::CommandsLost
        )
    }
}

/// A fault of one flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Injection {
    /// Which.
    pub kind: Kind,
    /// When it begins, s after the flight's start.
    pub begin: f64,
    /// For how long it lasts, s.
    pub duration: f64,
    /// How bad it is, 0 to 1.
    pub strength: f64,
    /// Which rotor, axis or direction it hits.
    pub index: usize,
}

impl Injection {
    /// A random fault of one of some kinds, at least one, that begins within `window` seconds.
    pub fn random(random: &mut Random, kinds: &[Kind], window: f64) -> Self {
        Self {
            kind: kinds[(random.bits() % kinds.len() as u64) as usize],
            begin: window * random.uniform(),
            duration: 0.02 + 3.0 * random.uniform() * random.uniform(),
            strength: random.uniform(),
            index: (random.bits() % 6) as usize,
        }
    }

    /// Between `low` and `high`, by its strength, in equal ratios.
    fn between(&self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.strength)
    }

    /// A unit vector along one axis, either way.
    fn direction(&self) -> Vector3 {
        let mut axis = Vector3::zeros();
        axis[self.index % 3] = if self.index < 3 { 1.0 } else { -1.0 };
        axis
    }

    /// What begins with it in the world.
    pub(super) fn begin(&self, simulation: &mut Simulation, out: &mut Vec<u8>) {
        let noise = *simulation.own_sensors();
        let mut sense = |params| *simulation.sensors_mut() = Sensors::new(params, self.index as u64);
        match self.kind {
            Kind::ImuNoise => {
                let k = self.between(3.0, 30.0);
                sense(SensorParams { gyro: k * noise.gyro, accelerometer: k * noise.accelerometer, ..noise });
            }
            Kind::GyroBias => {
                let gyro_bias_i = noise.gyro_bias_i + 0.2 * self.strength * self.direction();
                sense(SensorParams { gyro_bias_i, ..noise });
            }
            Kind::AccelerometerBias => {
                let accelerometer_bias_i = noise.accelerometer_bias_i + self.strength * self.direction();
                sense(SensorParams { accelerometer_bias_i, ..noise });
            }
            Kind::ImuSaturated => sense(SensorParams { gyro_bias_i: 40.0 * self.direction(), ..noise }),
            Kind::CaptureNoise => {
                let k = self.between(5.0, 100.0);
                let (position, orientation) = (k * noise.position, k.min(30.0) * noise.orientation);
                sense(SensorParams { position, orientation, ..noise });
            }
            Kind::RotorThrust => simulation.damage_rotor(self.index, 0.8 * self.strength),
            Kind::RotorSlow => simulation.weaken_rotor(self.index, 0.4 + 0.5 * self.strength),
            Kind::RotorStuck => simulation.weaken_rotor(self.index, 0.0),
            Kind::MotorEmergency => simulation.firmware_mut().fail_motor(self.index as u8 + 1, out),
            Kind::BatteryEmpty => {
                let battery = simulation.firmware_mut().battery_mut();
                battery.charge = 0.05 * battery.capacity * self.strength;
            }
            Kind::Reboot => {
                let now = simulation.now();
                simulation.firmware_mut().reboot(now);
            }
            _ => {}
        }
    }

    /// What ends with it. Broken rotors and empty batteries stay so.
    pub(super) fn end(&self, simulation: &mut Simulation) {
        if matches!(
            self.kind,
            Kind::ImuNoise
                | Kind::GyroBias
                | Kind::AccelerometerBias
                | Kind::ImuSaturated
                | Kind::CaptureNoise
        ) {
            let own = *simulation.own_sensors();
            *simulation.sensors_mut() = Sensors::new(own, 99);
        }
    }

    /// What it does to the bytes from the vehicle.
    pub(super) fn spoil_link(&self, bytes: &mut Vec<u8>, last_imu: &[u8], random: &mut Random) {
        match self.kind {
            Kind::BitFlips => self.flip_bits(bytes, random),
            Kind::FramesLost | Kind::FramesDuplicated | Kind::FramesReordered | Kind::FramesCut => {
                *bytes = self.shuffle(bytes, random);
            }
            Kind::Garbage if random.uniform() < 0.1 => {
                let count = (300.0 * self.strength * random.uniform()) as usize;
                bytes.extend((0..count).map(|_| random.bits() as u8));
            }
            Kind::ImuFrozen => {
                let frames = frames(bytes);
                let frozen = frames.into_iter().flat_map(|frame| match frame {
                    [b'^', b'I', sequence, ..] if last_imu.len() > 3 => {
                        let mut again = last_imu.to_vec();
                        again[2] = *sequence;
                        again
                    }
                    _ => frame.to_vec(),
                });
                *bytes = frozen.collect();
            }
            Kind::Unplugged => bytes.clear(),
            _ => {}
        }
    }

    /// Flips bits, also of commands.
    pub(super) fn flip_bits(&self, bytes: &mut [u8], random: &mut Random) {
        let every = self.between(20.0, 2000.0);
        for byte in bytes {
            if random.uniform() * every < 1.0 {
                *byte ^= 1 << (random.bits() % 8);
            }
        }
    }

    fn shuffle(&self, bytes: &[u8], random: &mut Random) -> Vec<u8> {
        let mut parts = frames(bytes);
        if self.kind == Kind::FramesReordered {
            for i in (1..parts.len()).rev() {
                parts.swap(i, (random.bits() % (i as u64 + 1)) as usize);
            }
        }
        let mut out = Vec::with_capacity(bytes.len());
        for frame in parts {
            let hit = random.uniform() < self.between(0.05, 1.0);
            match self.kind {
                Kind::FramesLost if hit => {}
                Kind::FramesCut if hit => {
                    out.extend_from_slice(&frame[..(random.bits() % frame.len() as u64) as usize]);
                }
                Kind::FramesDuplicated if hit => {
                    out.extend_from_slice(frame);
                    out.extend_from_slice(frame);
                }
                _ => out.extend_from_slice(frame),
            }
        }
        out
    }

    /// What it does to a pose; `None` where it is lost.
    pub(super) fn spoil_pose(&self, mut pose: PoseSample, random: &mut Random) -> Option<PoseSample> {
        match self.kind {
            Kind::CaptureLost => return None,
            Kind::CaptureFlips if random.uniform() < self.between(0.2, 1.0) => {
                pose.rotation_wr *= so3::exp(&(core::f64::consts::PI * self.direction()));
            }
            Kind::CaptureJumps => pose.position_w += self.direction() * self.between(0.05, 2.0),
            Kind::CaptureClock => pose.time += if self.index < 3 { -self.strength } else { self.strength },
            _ => {}
        }
        Some(pose)
    }
}

/// The frames in some bytes, each from its mark to the next one's; bytes before the first are one too.
fn frames(bytes: &[u8]) -> Vec<&[u8]> {
    let mut starts: Vec<_> = (0..bytes.len()).filter(|&i| i == 0 || bytes[i] == b'^').collect();
    starts.push(bytes.len());
    starts.windows(2).map(|pair| &bytes[pair[0]..pair[1]]).collect()
}
