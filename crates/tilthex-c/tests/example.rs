//! The example in C, compiled by a C compiler against the header and the static library, and run.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

/// The static library of this build: it lies beside the test, and the newest is this one.
fn library() -> PathBuf {
    let folder = env::current_exe().expect("the test").parent().expect("its folder").to_path_buf();
    let is_library = |path: &PathBuf| {
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        name.starts_with("libtilthex_c") && name.ends_with(".a")
    };
    fs::read_dir(folder)
        .expect("the folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(is_library)
        .max_by_key(|path| fs::metadata(path).and_then(|m| m.modified()).expect("its time"))
        .expect("a static library")
}

/// The rows of numbers that a program prints.
fn table(text: &str) -> Vec<Vec<f64>> {
    let row = |line: &str| line.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>().ok();
    text.lines().filter_map(row).filter(|row| row.len() == 5).collect()
}

#[test]
fn the_example_flies_in_c() {
    let compiler = env::var("CC").unwrap_or_else(|_| "gcc".into());
    if Command::new(&compiler).arg("--version").output().is_err() {
        println!("left out: {compiler} is not installed here");
        return;
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let out = tempfile::tempdir().expect("a folder");
    let program = out.path().join("hover_and_push");
    let compiled = Command::new(&compiler)
        .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-pedantic"])
        .arg("-I")
        .arg(folder.join("include"))
        .arg(folder.join("examples/hover_and_push.c"))
        .arg(library())
        .args(["-lm", "-lpthread", "-ldl", "-o"])
        .arg(&program)
        .output()
        .expect("the compiler runs");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));

    let run = Command::new(&program).output().expect("the program runs");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let rows = table(&String::from_utf8(run.stdout).expect("text"));
    assert_eq!(rows.len(), 9);
    let [_, _, observed, reference, tool] = rows[6][..] else { panic!("five columns") };
    // 1.4 N, less the dead zone of 0.2 N, against a spring of 6 N/m.
    assert!((observed - 1.4).abs() < 0.02, "{observed} N");
    assert!((reference - 0.2).abs() < 0.01 && (tool - reference).abs() < 0.005, "{reference} m, {tool} m");
    // Before the push nothing moves; in the 2 s after it the tool comes back, by about exp(-2 K/D).
    assert!(rows[0][2].abs() < 0.02 && rows[0][4].abs() < 1e-3, "{:?}", rows[0]);
    assert!((0.2..0.4).contains(&(rows[8][4] / tool)), "{:?}", rows[8]);
}
