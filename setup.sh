#!/bin/sh
# Sets up ICL-NUIM in .venv beside this script: system libraries that bpy needs, then the package. `./setup.sh test` adds what the tests need.
# Python 3.11 gets bpy 4.5 LTS, Python 3.13 gets bpy 5.2 LTS; PYTHON=... chooses, VENV=... names another folder.
set -eu
cd "$(dirname "$0")"
libraries="libgl1 libegl1 libsm6 libxi6 libxfixes3 libxrender1 libxxf86vm1 libxkbcommon0 libgomp1 libx11-6 libusb-1.0-0"

missing=""
if command -v dpkg >/dev/null; then
  for library in $libraries; do
    dpkg -s "$library" >/dev/null 2>&1 || missing="$missing $library"
  done
fi
if [ -n "$missing" ]; then
  if [ "$(id -u)" = 0 ]; then as_root=""; else as_root=sudo; fi
  $as_root apt-get update -q
  DEBIAN_FRONTEND=noninteractive $as_root apt-get install -y -q --no-install-recommends $missing
fi

venv=${VENV:-.venv}
[ -x "$venv/bin/python" ] || "${PYTHON:-python3}" -m venv "$venv"
extras=""
[ "${1:-}" = test ] && extras="[test]"
"$venv/bin/python" -m pip install -q --editable ".$extras"
