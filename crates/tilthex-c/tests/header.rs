//! The header is what cbindgen writes from the sources. `TILTHEX_WRITE_DOCS=1` writes it.

use std::{fs, path::Path};

fn generated(folder: &Path) -> String {
    let sources = ["status", "block", "vehicle", "numbers", "control", "estimate", "plant"];
    let mut builder = cbindgen::Builder::new()
        .with_config(cbindgen::Config::from_file(folder.join("cbindgen.toml")).expect("cbindgen.toml"));
    for source in sources {
        builder = builder.with_src(folder.join(format!("src/{source}.rs")));
    }
    let mut header = Vec::new();
    builder.generate().expect("bindings").write(&mut header);
    String::from_utf8(header).expect("text")
}

#[test]
fn the_header_is_that_of_the_sources() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (path, header) = (folder.join("include/tilthex.h"), generated(folder));
    if std::env::var_os("TILTHEX_WRITE_DOCS").is_some() {
        fs::write(&path, &header).expect("the header is written");
    }
    let committed = fs::read_to_string(&path).expect("the header");
    assert!(committed == header, "include/tilthex.h is out of date: run this test with TILTHEX_WRITE_DOCS=1");
    let functions = header.matches("TilthexStatus tilthex_").count();
    assert!(functions >= 18, "{functions} functions");
}
