//! A smooth 6-D motion in closed form, and the sensors that ride on it.
use tilthex_core::{
    GRAVITY, Matrix3, PoseSample, RobotState, Vector3, plant::SensorParams, random::Random, so3,
};

/// Sums of sines with seeded amplitudes, rates and phases.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    waves: [[(f64, f64, f64); 2]; 6],
}

impl Motion {
    /// Up to about 1 m, 2 m/s, 0.5 rad and 1.5 rad/s.
    pub fn new(random: &mut Random) -> Self {
        let mut waves = [[(0.0, 0.0, 0.0); 2]; 6];
        for (axis, pair) in waves.iter_mut().enumerate() {
            for (k, wave) in pair.iter_mut().enumerate() {
                let rate = [1.0, 4.0][k] * (0.6 + 0.8 * random.uniform());
                let amplitude = [[0.7, 0.06], [0.4, 0.08]][axis / 3][k] * (0.5 + random.uniform());
                *wave = (amplitude, rate, core::f64::consts::TAU * random.uniform());
            }
        }
        Self { waves }
    }

    /// Value, first and second derivative of a triple of axes.
    fn triple(&self, first: usize, t: f64) -> [Vector3; 3] {
        let mut out = [Vector3::zeros(); 3];
        for (axis, waves) in self.waves[first..first + 3].iter().enumerate() {
            for &(a, w, phase) in waves {
                let (s, c) = (w * t + phase).sin_cos();
                out[0][axis] += a * s;
                out[1][axis] += a * w * c;
                out[2][axis] -= a * w * w * s;
            }
        }
        out
    }

    pub fn state(&self, t: f64) -> RobotState {
        let [position_w, velocity_w, _] = self.triple(0, t);
        let [angle, rate, _] = self.triple(3, t);
        RobotState {
            position_w,
            velocity_w,
            rotation_wr: so3::exp(&angle),
            angular_velocity_r: so3::left_jacobian(&-angle) * rate,
        }
    }

    /// Gyro and specific force of an IMU at `arm` (robot), aligned with the robot.
    pub fn imu(&self, t: f64, arm: &Vector3) -> (Vector3, Vector3) {
        let state = self.state(t);
        let h = 1e-5;
        let omega = state.angular_velocity_r;
        let alpha = (self.state(t + h).angular_velocity_r - self.state(t - h).angular_velocity_r) / (2.0 * h);
        let free_w = self.triple(0, t)[2] + Vector3::new(0.0, 0.0, GRAVITY);
        let force =
            state.rotation_wr.transpose() * free_w + alpha.cross(arm) + omega.cross(&omega.cross(arm));
        (omega, force)
    }
}

/// What the sensors of a motion read: an IMU at 500 Hz and poses at 100 Hz.
#[derive(Clone, Debug)]
pub struct Recording {
    pub imu: Vec<(f64, Vector3, Vector3)>,
    /// With `arrival == time`.
    pub poses: Vec<PoseSample>,
    pub truth: Vec<RobotState>,
}

impl Recording {
    pub fn new(
        motion: &Motion,
        sensors: &SensorParams,
        arm: &Vector3,
        duration: f64,
        random: &mut Random,
    ) -> Self {
        let (mut imu, mut poses, mut truth) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..(500.0 * duration) as usize {
            let t = k as f64 / 500.0;
            let (gyro, force) = motion.imu(t, arm);
            let state = motion.state(t);
            imu.push((
                t,
                gyro + sensors.gyro_bias_i + random.normal3(sensors.gyro),
                force + sensors.accelerometer_bias_i + random.normal3(sensors.accelerometer),
            ));
            if k % 5 == 0 {
                poses.push(PoseSample {
                    time: t,
                    arrival: t,
                    position_w: state.position_w + random.normal3(sensors.position),
                    rotation_wr: so3::exp(&random.normal3(sensors.orientation)) * state.rotation_wr,
                    tracking_valid: true,
                });
            }
            truth.push(state);
        }
        Self { imu, poses, truth }
    }
}

/// Turns a pose's body by 180 degrees about an axis of its own, as swapped markers do.
pub fn flipped(pose: &PoseSample) -> PoseSample {
    let half_turn = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
    PoseSample { rotation_wr: pose.rotation_wr * half_turn, ..*pose }
}
