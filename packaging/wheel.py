"""`make wheel`: builds a manylinux_2_28 wheel with both programs, and checks it with two auditors.

A plain build needs the glibc of the machine that builds it, and package indexes do not accept it. Zig
links against the glibc that the tag names. `cargo-zigbuild`, `ziglang`, `auditwheel` and `abi3audit` come
from the package index.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import tilthex_build

GLIBC = "2.28"


def main() -> None:
    """Builds into `dist`, audits, and prints the wheel's path."""
    target = f"{platform.machine()}-unknown-linux-gnu"
    dist = tilthex_build.ROOT / "dist"
    before = set(dist.glob("*.whl"))
    for wheel in before:
        wheel.unlink()
    tilthex_build.build_programs(["zigbuild", "--target", f"{target}.{GLIBC}"])
    command = [sys.executable, "-m", "maturin", "build", "--release", "--locked", "--zig", "--target", target]
    command += ["--compatibility", f"manylinux_{GLIBC.replace('.', '_')}", "--out", str(dist)]
    subprocess.run(command, cwd=tilthex_build.ROOT, check=True, env=_environment())
    [wheel] = dist.glob("*.whl")
    for auditor in (["auditwheel", "show"], ["abi3audit", "--strict"]):
        subprocess.run([_beside(auditor[0]), *auditor[1:], str(wheel)], check=True)
    print(wheel)


def _beside(program: str) -> str:
    return str(Path(sys.executable).with_name(program))


def _environment() -> dict[str, str]:
    """The environment with this interpreter's programs first on the path: maturin calls cargo-zigbuild."""
    folder = str(Path(sys.executable).parent)
    return os.environ | {"PATH": folder + os.pathsep + os.environ.get("PATH", "")}


if __name__ == "__main__":
    main()
