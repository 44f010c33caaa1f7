//! The controller on the base PC.

fn main() -> std::process::ExitCode {
    tilthex_rt::failure::exit("tilthex-rt", tilthex_rt::app::run())
}
