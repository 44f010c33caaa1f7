//! The simulated vehicle alone, for anyone's controller.

fn main() -> std::process::ExitCode {
    tilthex_rt::failure::exit("tilthex-sim", tilthex_rt::sim_app::run())
}
