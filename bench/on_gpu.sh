#!/usr/bin/env bash
# Everything that needs an NVIDIA GPU, in one script of at most 9 minutes on a bare machine: versions, tests on the
# device, kernels and registrations timed. It has not been run on a GPU yet.
#
#   bash bench/on_gpu.sh [FOLDER]     FOLDER gets results and logs; default: bench/results/gpu
#
# PYTHON names an interpreter (default: python3). WHEELS names a folder of wheels, for machines that reach no package
# registry; there voxjax[cuda,test] must be installable from it alone. VENV names an environment that is used as it is.
# Each part has a time of its own; what it ended with stands in FOLDER/parts.json, and a part that fails stops no other.
set -uo pipefail

here="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
out="${1:-$here/bench/results/gpu}"
python="${PYTHON:-python3}"
mkdir -p "$out"
out="$(cd "$out" && pwd)"
cd "$here" || exit 1
: > "$out/parts.jsonl"
failed=0

# part NAME SECONDS COMMAND...: runs a command under a time limit and notes how it ended.
part() {
  local name="$1" limit="$2" began="$SECONDS" code
  shift 2
  printf '\n==> %s (at most %s s)  [%d s]\n' "$name" "$limit" "$SECONDS"
  timeout --kill-after=5 "$limit" "$@" > "$out/$name.log" 2>&1
  code=$?
  tail -n 15 "$out/$name.log"
  [ "$code" -eq 0 ] || failed=1
  printf '{"part": "%s", "exit": %d, "seconds": %d, "limit": %d}\n' \
    "$name" "$code" "$((SECONDS - began))" "$limit" >> "$out/parts.jsonl"
}

install() {
  "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed"; return 2; }
  "$python" -m venv "$here/.venv-gpu" || return
  if [ -n "${WHEELS:-}" ]; then
    "$here/.venv-gpu/bin/python" -m pip install -q --no-index --find-links "$WHEELS" -e "$here[cuda,test]"
  else
    "$here/.venv-gpu/bin/python" -m pip install -q -e "$here[cuda,test]"
  fi
}
export -f install
export here python

versions='
import json, platform, shutil, subprocess, sys, jax, jaxlib, numpy, voxjax
device = jax.devices()[0]
smi = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
found = {
    "device": device.device_kind, "platform": device.platform, "python": platform.python_version(),
    "jax": jax.__version__, "jaxlib": jaxlib.__version__, "numpy": numpy.__version__, "voxjax": voxjax.__version__,
    "nvidia_smi": subprocess.run(smi, capture_output=True, text=True).stdout.strip() if shutil.which(smi[0]) else None,
}
print(json.dumps(found, indent=1))
json.dump(found, open(sys.argv[1], "w"), indent=1)
sys.exit(0 if device.platform == "gpu" else "JAX finds no GPU here: is voxjax[cuda] installed, and does nvidia-smi work?")
'

if [ -n "${VENV:-}" ]; then run="$VENV/bin/python"; else part install 120 bash -c install; run="$here/.venv-gpu/bin/python"; fi
# The host stays a device beside the GPU; memory is taken as it is needed, so that parts do not crowd each other.
export PYTHONPATH="$here/src:$here${PYTHONPATH:+:$PYTHONPATH}"
export JAX_PLATFORMS=cuda,cpu XLA_PYTHON_CLIENT_PREALLOCATE=false
cache="$(mktemp -d)"
trap 'rm -rf "$cache"' EXIT
export JAX_COMPILATION_CACHE_DIR="$cache" JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS=0.2

part versions 30 "$run" -c "$versions" "$out/versions.json"
# Without a GPU JAX falls back to the CPU, where tests of the GPU are skipped and nothing else would be worth its time.
if [ "$failed" -eq 0 ]; then
  part gpu_tests 120 "$run" -m pytest -q -m gpu tests/gpu -p no:cacheprovider
  part oracles 100 "$run" -m pytest -q tests/ops -p no:cacheprovider --ignore tests/ops/test_lowering.py
  part kernels 70 "$run" -m bench kernels --quick --device cuda --results "$out"
  part registration 80 "$run" -m bench registration --only "" --generated 6 --seed 7 --warm --out "$out/registration.json"
fi

"$python" - "$out" <<'PYTHON'
import json, pathlib, sys
folder = pathlib.Path(sys.argv[1])
lines = (folder / "parts.jsonl").read_text().splitlines()
(folder / "parts.json").write_text(json.dumps([json.loads(line) for line in lines], indent=1) + "\n")
(folder / "parts.jsonl").unlink()
print((folder / "parts.json").read_text())
PYTHON
exit "$failed"
