# Makes .venv with the locked packages and grape itself; sourced by ./run and ./test. Does nothing when it is up to date.
#   bootstrap          what a mission needs
#   bootstrap test     also what the tests need

ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
VENV="$ROOT/.venv"
export MUJOCO_GL="${MUJOCO_GL:-egl}"

say() { printf 'grape: %s\n' "$*" >&2; }

find_python() {
    local name
    for name in ${GRAPE_PYTHON:-} python3.11 python3.12 python3.13 python3; do
        if command -v "$name" >/dev/null && "$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$name"
            return
        fi
    done
    return 1
}

has_library() { { ldconfig -p || /sbin/ldconfig -p; } 2>/dev/null | grep -q "$1"; }

install_with_apt() { # packages …
    local as_root=()
    if ! command -v apt-get >/dev/null; then
        say "please install these first (no apt-get here): $*"
        return 1
    fi
    if [ "$(id -u)" -ne 0 ]; then
        if ! command -v sudo >/dev/null; then
            say "please install these system packages first (no root, no sudo here): $*"
            return 1
        fi
        as_root=(sudo)
    fi
    say "installing system packages: $*"
    "${as_root[@]}" apt-get update -q >&2
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "$@" >&2
}

install_python() {
    install_with_apt python3 python3-venv
    # Ubuntu 22.04 has 3.10 under that name, and 3.11 beside it.
    find_python >/dev/null || install_with_apt python3.11 python3.11-venv
    if ! find_python >/dev/null; then
        say "needs Python 3.11 or newer; found $(python3 --version 2>&1 || echo none)."
        return 1
    fi
}

install_system_packages() { # the python
    local wanted=()
    "$1" -c 'import ensurepip, venv' 2>/dev/null || wanted+=("python$("$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv")
    has_library 'libEGL\.so\.1' || wanted+=(libegl1)
    has_library 'libGL\.so\.1' || wanted+=(libgl1)
    has_library 'libusb-1\.0\.so\.0' || wanted+=(libusb-1.0-0)
    if [ ${#wanted[@]} -gt 0 ]; then install_with_apt "${wanted[@]}"; fi
}

wanted_stamp() {
    echo "$(cat "$ROOT/requirements.lock" "$ROOT/requirements-test.lock" "$ROOT/pyproject.toml" | sha256sum) $ROOT"
}

up_to_date() { [ -x "$VENV/bin/python" ] && [ -f "$VENV/.stamp-$1" ] && [ "$(cat "$VENV/.stamp-$1")" = "$(wanted_stamp)" ]; }

install_packages() { # stamp name, then pip arguments
    local stamp="$1"
    shift
    if up_to_date "$stamp"; then return; fi
    say "installing packages ($*) …"
    "$VENV/bin/python" -m pip install -q --disable-pip-version-check --no-deps "$@" >&2
    "$VENV/bin/python" -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e "$ROOT" >&2
    wanted_stamp >"$VENV/.stamp-$stamp"
}

bootstrap() {
    local python
    if up_to_date "${1:-run}"; then return; fi
    exec 9>"$ROOT/.bootstrap.lock"
    if command -v flock >/dev/null; then flock 9; fi
    if ! [ -x "$VENV/bin/python" ] || ! "$VENV/bin/python" -m pip --version >/dev/null 2>&1; then
        find_python >/dev/null || install_python
        python="$(find_python)"
        install_system_packages "$python"
        say "making .venv with $("$python" --version)"
        rm -rf "$VENV"
        "$python" -m venv "$VENV"
    fi
    install_packages run -r "$ROOT/requirements.lock"
    if [ "${1:-}" = test ]; then
        install_packages test -r "$ROOT/requirements.lock" -r "$ROOT/requirements-test.lock"
    fi
    exec 9>&-
}
