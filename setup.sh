#!/bin/sh
# Installs the system libraries that Blender's Python package bpy needs, then iclnuim into .venv next to this script.
# usage: ./setup.sh [EXTRA ...]    extras: notebook, test, dev, docs, ros, rerun, slurm, open3d, completion
#
# Python 3.11 gets bpy 4.5 LTS, Python 3.13 gets bpy 5.2 LTS. If neither is installed, uv (from PyPI) fetches 3.11, or the Python of an
# installed Blender is used. PYTHON=python3.12 ./setup.sh installs without bpy. VENV=FOLDER installs into another folder than .venv.
set -eu
cd "$(dirname "$0")"
venv=${VENV:-.venv}
libraries="libgl1 libegl1 libsm6 libxi6 libxfixes3 libxrender1 libxxf86vm1 libxkbcommon0 libgomp1 libx11-6 libusb-1.0-0"

note() { echo "setup.sh: $*" >&2; }
fail() { note "$*"; exit 1; }
version() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || true; }

# has_bpy PYTHON: succeeds if there is a bpy package for this Python
has_bpy() { case $(version "$1") in 3.11 | 3.13) true ;; *) false ;; esac }

installed_python() {
  pyenv=${PYENV_ROOT:-$HOME/.pyenv}/versions
  for candidate in python3 python3.11 python3.13 "$pyenv"/3.11*/bin/python "$pyenv"/3.13*/bin/python; do
    if has_bpy "$candidate"; then command -v "$candidate" && return; fi
  done
  return 1
}

fetched_python() {
  note "no Python 3.11 or 3.13 found; fetching 3.11 with uv"
  scratch=$(mktemp -d)
  fetched=$(
    uv=$(command -v uv) || {
      python3 -m venv "$scratch" && "$scratch/bin/python" -m pip install -q uv
      uv=$scratch/bin/uv
    } >&2
    "$uv" python install 3.11 >&2 && "$uv" python find --managed-python 3.11
  ) 2>"$scratch/log" || fetched=""
  rm -rf "$scratch"
  [ -n "$fetched" ] && echo "$fetched"
}

blender_python() {
  command -v blender >/dev/null || return 1
  found=$(blender -b --factory-startup --python-expr 'import bpy, sys; bpy.app.version >= (4, 2) and print("python:" + sys.executable)' \
    2>/dev/null | sed -n 's/^python://p')
  has_bpy "$found" && echo "$found"
}

if [ -x "$venv/bin/python" ]; then
  python=$venv/bin/python
elif [ -n "${PYTHON:-}" ]; then
  python=$PYTHON
else
  python=$(installed_python || fetched_python || blender_python) || {
    found=$(version python3)
    advice="install Python 3.11 (with pyenv: pyenv install 3.11; on Ubuntu: ppa:deadsnakes/ppa, python3.11-venv) and run ./setup.sh again"
    [ "$found" != 3.12 ] || advice="$advice; or install without Blender: PYTHON=python3 ./setup.sh"
    fail "expected Python 3.11 or 3.13, found ${found:-none}, and 3.11 could not be fetched: $advice"
  }
fi

found=$(version "$python")
case $found in
  3.11 | 3.13) ;;
  3.12)
    libraries="libgl1 libgomp1 libx11-6 libusb-1.0-0"
    note "there is no package bpy for Python 3.12: evaluation, noise, odometry and fusion will work; rendering needs Python 3.11 or 3.13"
    ;;
  *) fail "$python: expected Python 3.11 or 3.13 (3.12 works without Blender), found ${found:-no version}; try: PYTHON=/path/to/python3.11 ./setup.sh" ;;
esac

note "Python $found: $python"
missing=""
if command -v dpkg >/dev/null; then
  "$python" -c 'import ensurepip' 2>/dev/null || libraries="$libraries python$found-venv"
  for library in $libraries; do
    dpkg -s "$library" >/dev/null 2>&1 || missing="$missing $library"
  done
fi
if [ -n "$missing" ]; then
  as_root=""
  if [ "$(id -u)" != 0 ]; then
    command -v sudo >/dev/null || fail "system packages are missing; run as root: apt-get install$missing"
    as_root=sudo
  fi
  note "installing system packages:$missing"
  $as_root apt-get update -q
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $missing
fi

extras=$(echo "$*" | tr ' ' ',')
what=".${extras:+[$extras]}"
note "installing packages into $venv: about 10 s with uv, 40 s with pip; 1.5 GB"
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
uv=$(command -v uv) || {
  "$venv/bin/python" -m pip install -q uv 2>/dev/null || true
  uv=$venv/bin/uv
}
# bytecode is written when a module is first imported, as compiling all of it takes longer than unpacking
if ! { [ -x "$uv" ] && "$uv" pip install -q --python "$venv/bin/python" --editable "$what" 2>/dev/null; }; then
  note "by pip, as uv could not install them"
  "$venv/bin/python" -m pip install -q --no-compile --editable "$what"
fi

note "done. Next:"
echo "  . $venv/bin/activate"
if has_bpy "$venv/bin/python"; then echo "  iclnuim make kt2 --quick    # 60 frames, clean and noisy, in out/: half a minute"; fi
case " $* " in *" notebook "*) echo "  jupyter lab examples         # the notebooks" ;; esac
case " $* " in *" test "*) echo "  python -m pytest            # the tests" ;; esac
echo "  iclnuim --help              # all commands; README.md has the common tasks"
