//! `--truth` of the programs.

#![allow(clippy::unwrap_used)]

#[test]
fn the_programs_refuse_a_truth_that_is_none_in_one_sentence() {
    let (sim, rt) = (env!("CARGO_BIN_EXE_tilthex-sim"), env!("CARGO_BIN_EXE_tilthex-rt"));
    for (program, arguments, said) in [
        (sim, ["--truth", "cda"].as_slice(), "unknown level `cda`; the nearest known one is `cad`"),
        (sim, &["--truth", "nowhere.toml"], "nowhere.toml"),
        (rt, &["--sim", "--take-off", "--truth", "cda"], "unknown level `cda`"),
        (rt, &["campaign", "--number", "1", "--truth", "cda"], "unknown level `cda`"),
        (rt, &["--truth", "cad"], "--sim"),
    ] {
        let done = std::process::Command::new(program).args(arguments).output().unwrap();
        let sentence = String::from_utf8(done.stderr).unwrap();
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {sentence}");
        assert!(sentence.contains(said), "{arguments:?}: {sentence}");
    }
}
