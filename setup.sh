#!/bin/sh
# `setup.sh packages` makes .venv with the locked packages; `setup.sh gmsh` sees to the system libraries of gmsh.
set -eu
cd "$(dirname "$0")"
compiled="attr attrs click jsonschema jsonschema_specifications matplotlib meshio mpmath numpy pandas pyamg
    referencing scipy skfem xarray yaml"
libraries="libgl1 libglu1-mesa libxcursor1 libxft2 libxinerama1 libgomp1"

stop() {
    echo "$1" >&2
    exit 1
}

check_python() {
    command -v python3 >/dev/null || stop "unilateral needs Python 3.11 or later, and there is no python3 in PATH."
    python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
        stop "unilateral needs Python 3.11 or later, and python3 is $(python3 --version 2>&1)."
    python3 -c 'import ensurepip, venv' 2>/dev/null ||
        stop "unilateral needs Python's venv module; on Debian or Ubuntu type: sudo apt-get install python3-venv"
}

install_packages() {
    check_python
    echo "Setting up .venv with the locked packages (once; about a minute, needs the network) ..."
    rm -f .venv/installed .venv/ready
    python3 -m venv --clear .venv || stop "Python's venv module could not make .venv (see above)."
    .venv/bin/python -m pip install -qq --disable-pip-version-check --no-compile --require-hashes -r requirements.txt ||
        stop "The packages of requirements.txt could not be installed (see above); 'make' tries again."
    .venv/bin/python -m pip install -qq --disable-pip-version-check --no-deps --no-build-isolation -e . ||
        stop "The package unilateral itself could not be installed (see above); 'make' tries again."
    # The study and the benchmarks are no part of the package: their folders in the clone are on Python's path.
    printf '%s\n' "$PWD/src" "$PWD" >"$(packages_folder)/study.pth"
    compile_packages
    pwd -P >.venv/installed
}

packages_folder() {
    .venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("platlib"))'
}

# What every process imports, also where PYTHONDONTWRITEBYTECODE has each of them compile it again, for seconds;
# not their tests. Python sees by a file's time stamp that it was edited later.
compile_packages() {
    packages=$(packages_folder)
    for name in $compiled; do
        set -- "$@" "$packages/$name"
    done
    .venv/bin/python -m compileall -q -j 0 -x '/tests?/' src "$@" ||
        stop "Installed packages could not be compiled (see above); 'make' tries again."
}

gmsh_loads() {
    .venv/bin/python -c 'import gmsh' 2>/dev/null
}

install_libraries() {
    if ! gmsh_loads && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        echo "gmsh cannot be loaded: installing its system libraries ($libraries) with apt-get ..."
        export DEBIAN_FRONTEND=noninteractive
        # shellcheck disable=SC2086
        apt-get update -qq && apt-get install -qq -y --no-install-recommends $libraries >/dev/null || true
    fi
    reason=$(.venv/bin/python -c 'import gmsh' 2>&1 | tail -n 1)
    gmsh_loads || stop "gmsh cannot be loaded ($reason); on Debian or Ubuntu type: sudo apt-get install $libraries"
    touch .venv/ready
}

case "${1:-}" in
packages) install_packages ;;
gmsh) install_libraries ;;
*) stop "usage: setup.sh packages|gmsh" ;;
esac
