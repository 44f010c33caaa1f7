//! Records a simulated flight, and compares what the board made of it with what this computer makes of it.

use std::{fs, path::Path, process::ExitCode};
use tilthex_core::{
    Matrix3, Vector3,
    plant::{Loads, Plant, SensorParams, Sensors},
    so3,
    types::Wrench,
};
use tilthex_onboard::{Chain, INPUT_WORDS, Input, OUTPUT_WORDS, PERIOD};

/// Ticks of the flight: 20 s.
const TICKS: usize = 10_000;
/// Ticks between two poses, and the ticks by which a pose is late.
const POSE: (usize, usize) = (5, 8);
/// Seed of the sensors' noise.
const SEED: u64 = 1;

/// Largest distance of the tool from its set-point at the end, m.
const LARGEST_ERROR: f64 = 0.05;

/// Where the flight begins, m, world.
fn start() -> Vector3 {
    Vector3::new(0.0, 0.0, 1.0)
}

/// What the environment exerts on the tool, world: a push to the side, then one upwards with a torque, then a blow.
fn push(time: f64) -> Wrench {
    let (force, torque) = match time {
        t if (2.0..6.0).contains(&t) => (Vector3::new(1.4, 0.5, 0.0), Vector3::zeros()),
        t if (8.0..11.0).contains(&t) => (Vector3::new(0.0, -1.0, 2.0), Vector3::new(0.3, 0.0, -0.3)),
        t if (13.0..13.05).contains(&t) => (Vector3::new(-20.0, 5.0, 0.0), Vector3::zeros()),
        _ => (Vector3::zeros(), Vector3::zeros()),
    };
    Wrench { force, torque }
}

/// The set-point of the tool: it holds, then moves and turns.
fn setpoint(home_w: &Vector3, time: f64) -> (Vector3, Matrix3) {
    let part = ((time - 14.0) / 4.0).clamp(0.0, 1.0);
    let smooth = part * part * (3.0 - 2.0 * part);
    (home_w + smooth * Vector3::new(0.5, -0.3, 0.2), so3::rot_z(0.6 * smooth) * so3::rot_x(0.2 * smooth))
}

/// Flies, and returns the inputs of all ticks, and how far the tool is from its set-point in the end, m.
fn fly(ticks: usize) -> Result<(Vec<Input>, f64), tilthex_core::Error> {
    let mut chain = Chain::new(&start(), &Matrix3::identity())?;
    let plant = Plant::new(*chain.vehicle());
    let (mut state, mut external) = (plant.hover(start()), Wrench::ZERO);
    let mut sensors = Sensors::new(SensorParams::EXPERIMENTS, SEED);
    let home_w = plant.tool_pose(&state).0;
    let (mut inputs, mut poses) = (Vec::with_capacity(ticks), Vec::new());
    for k in 1..=ticks {
        let time = PERIOD * k as f64;
        let imu = sensors.imu(&plant.imu(&state, &external));
        if k % POSE.0 == 0 {
            let (position_w, rotation_wr) = sensors.pose(&state);
            poses.push((k + POSE.1, (time, position_w, rotation_wr)));
        }
        let arrived = poses.iter().position(|(at, _)| *at == k).map(|i| poses.remove(i).1);
        let (position_w, rotation_we) = setpoint(&home_w, time);
        let input = Input {
            gyro_i: imu.gyro_i,
            specific_force_i: imu.specific_force_i,
            rotor_speeds: sensors.rotor_speeds(&plant, &state),
            pose: arrived,
            position_w,
            rotation_we,
        };
        let command = chain.tick(&input, &mut |_, part| part()).controller.rotor_speeds;
        inputs.push(input);
        let loads = Loads { external: Wrench::ZERO, tool_w: push(time) };
        plant.step_under(&mut state, &command, &loads, PERIOD);
        external = plant.from_tool(&state, &loads.tool_w);
    }
    let away = (plant.tool_pose(&state).0 - setpoint(&home_w, PERIOD * ticks as f64).0).norm();
    Ok((inputs, away))
}

/// Numbers as bytes.
fn bytes<'a>(words: impl IntoIterator<Item = &'a f64>) -> Vec<u8> {
    words.into_iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// Numbers of bytes.
fn words(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks().0.iter().map(|eight| f64::from_le_bytes(*eight)).collect()
}

fn record(path: &Path) -> Result<String, String> {
    let (inputs, away) = fly(TICKS).map_err(|e| e.to_string())?;
    if away > LARGEST_ERROR {
        return Err(format!(
            "the flight ends {away} m from its set-point; expected at most {LARGEST_ERROR} m"
        ));
    }
    let all: Vec<f64> = inputs.iter().flat_map(Input::to_words).collect();
    fs::write(path, bytes(&all)).map_err(|e| format!("cannot write {}: {e}", path.display()))?;
    Ok(format!("recorded {} ticks of {} s, seed {SEED}", inputs.len(), PERIOD))
}

fn judge(flight: &Path, board: &Path) -> Result<String, String> {
    let read = |path: &Path| fs::read(path).map_err(|e| format!("cannot read {}: {e}", path.display()));
    compare(&words(&read(flight)?), &read(board)?)
}

/// Compares the outputs of the board with those of this computer, bit for bit.
fn compare(inputs: &[f64], found: &[u8]) -> Result<String, String> {
    let mut chain = Chain::new(&start(), &Matrix3::identity()).map_err(|e| e.to_string())?;
    let ticks = inputs.as_chunks::<INPUT_WORDS>().0;
    let expected_length = 8 * OUTPUT_WORDS * ticks.len();
    if found.len() != expected_length {
        return Err(format!("the board wrote {} bytes; expected {expected_length}", found.len()));
    }
    for (k, (input, found)) in ticks.iter().zip(found.chunks_exact(8 * OUTPUT_WORDS)).enumerate() {
        let expected = bytes(&replayed(&mut chain, input));
        if expected != found {
            let place = expected.iter().zip(found).position(|(a, b)| a != b).unwrap_or(0) / 8;
            let [here, there] = [&expected[..], found].map(|b| words(b)[place]);
            return Err(format!("tick {k}, number {place}: {here:?} here, {there:?} on the board"));
        }
    }
    Ok(format!("{} ticks, {OUTPUT_WORDS} numbers each: bit for bit as on the host", ticks.len()))
}

/// The outputs of one tick.
fn replayed(chain: &mut Chain, input: &[f64; INPUT_WORDS]) -> [f64; OUTPUT_WORDS] {
    let output = chain.tick(&Input::from_words(input), &mut |_, part| part());
    chain.words(&output)
}

pub(crate) fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let done = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["record", flight] => record(Path::new(flight)),
        ["judge", flight, board] => judge(Path::new(flight), Path::new(board)),
        _ => Err("expected: record FLIGHT, or judge FLIGHT BOARD".into()),
    };
    match done {
        Ok(sentence) => {
            println!("{sentence}");
            ExitCode::SUCCESS
        }
        Err(sentence) => {
            eprintln!("tilthex-onboard: {sentence}");
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_bit_is_found_and_named() {
        let (inputs, _) = fly(100).expect("a flight");
        assert!(inputs.iter().all(|input| Input::from_words(&input.to_words()) == *input));
        let recorded: Vec<f64> = inputs.iter().flat_map(Input::to_words).collect();
        let mut chain = Chain::new(&start(), &Matrix3::identity()).expect("a chain");
        let outputs: Vec<f64> =
            recorded.as_chunks().0.iter().flat_map(|input| replayed(&mut chain, input)).collect();
        assert!(outputs.iter().all(|x| x.is_finite()));
        // The last numbers of a tick are the rotors that the vehicle does not have.
        assert!(outputs.as_chunks::<OUTPUT_WORDS>().0.iter().all(|o| o[OUTPUT_WORDS - 7] > 0.0));
        let same = bytes(&outputs);
        assert!(compare(&recorded, &same).is_ok());
        for place in [0, 5 * OUTPUT_WORDS + 17, outputs.len() - 1] {
            let mut other = same.clone();
            other[8 * place] ^= 1;
            let sentence = compare(&recorded, &other).expect_err("one bit is other");
            let named = format!("tick {}, number {}:", place / OUTPUT_WORDS, place % OUTPUT_WORDS);
            assert!(sentence.starts_with(&named), "{sentence}");
        }
        assert!(compare(&recorded, &same[8..]).is_err());
    }
}
