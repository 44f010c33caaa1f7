//! Compiles `proto/tilthex.proto` to the Rust messages and to the descriptor set that every log carries.

use std::{env, error::Error, fs, path::PathBuf};

use prost_build::Config;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=proto/tilthex.proto");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).open_file("tilthex.proto")?;
    fs::write(out.join("tilthex.descriptor.bin"), compiler.encode_file_descriptor_set())?;
    Config::new().out_dir(&out).compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}
