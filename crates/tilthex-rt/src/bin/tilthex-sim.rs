//! The simulated vehicle alone, for any controller.

fn main() -> std::process::ExitCode {
    tilthex_rt::failure::exit("tilthex-sim", tilthex_rt::sim_app::run())
}
