#!/usr/bin/env bash
# Runs motifold as arm64 programs do, emulated (qemu), and compares it with this x86-64 machine:
# decoded states and floats of an archive made here and of the frozen archives must be equal, and an
# archive made there must hold its certificates here. For Debian and Ubuntu, as root; some 2 GB of disk.
#
#   benchmarks/arm64/arm64.sh LIBRARY WORK      24 clips or more, or no model is learned
#
# constriction has no wheel for arm64 Linux: the folder standin beside this script stands in for it there.
set -euo pipefail
own=$(realpath "$(dirname "$0")") library=$(realpath "$1")
project=$(realpath "$own/../..")
mkdir -p "$2"; work=$(realpath "$2"); cd "$work"
tolerance=${TOLERANCE:-1mm} python=3.11 # of Debian bookworm

if ! { command -v qemu-aarch64-static && command -v debootstrap; } >/dev/null; then
  apt-get update -q
  apt-get install -q -y --no-install-recommends qemu-user-static debootstrap debian-archive-keyring python3-venv
fi

# Python for arm64: only unpacked, never set up.
if [ ! -x root/usr/bin/python$python ]; then
  rm -rf fetched root
  debootstrap --foreign --arch=arm64 --variant=minbase --include=python3 bookworm fetched > debootstrap.log
  for package in fetched/var/cache/apt/archives/*.deb; do dpkg -x "$package" root; done
  rm -rf fetched
fi

# The project twice, each with the compiled loops of its own processor, and its libraries for both.
for machine in x86 arm; do
  mkdir -p $machine; git -C "$project" archive HEAD | tar xf - -C $machine
  mkdir -p $machine/.src; ln -sfn .. $machine/.src/motifold
done
versions="-c x86/constraints.txt"
[ -d venv ] || { python3 -m venv venv; venv/bin/pip install -q $versions constriction; }
needs=$(grep -oE '^(c3d|dask|distributed|numba|numpy|scikit-learn|scipy|threadpoolctl|typer|zarr|pytest|hypothesis)==' \
  x86/constraints.txt | tr -d =)
venv/bin/pip install -q $versions $needs
if [ ! -d libraries ]; then
  wheels=$(printf -- '--platform manylinux%s_aarch64 ' 2014 _2_17 _2_26 _2_27 _2_28)
  venv/bin/pip install -q --target new $versions --only-binary=:all: --python-version $python \
    --implementation cp $wheels $needs
  mv new libraries
fi
here() { PYTHONPATH=$work/x86/.src nice venv/bin/python -W ignore "$@"; }
there() {
  PYTHONPATH=$work/libraries:$own/standin:$work/arm/.src QEMU_LD_PREFIX=$work/root OPENBLAS_NUM_THREADS=1 \
    nice qemu-aarch64-static root/usr/bin/python$python -W ignore "$@"
}
there -c "import platform, numpy, numba; print(platform.machine(), platform.python_version(), numpy.__version__, numba.__version__)"

rm -rf made-*; here -m motifold archive "$library" made-here --tolerance "$tolerance"
for machine in here there; do
  $machine "$own/state_digests.py" made-here x86/tests/fixtures/v*/archive > digests-$machine
done
cmp digests-here digests-there && echo "$(wc -l < digests-here) clips: states and floats are equal"
there -m motifold archive "$library" made-there --tolerance "$tolerance" --workers 1
here -m motifold verify made-there --decode --library "$library"
diff -rq --exclude=catalog made-here made-there && echo "both archives have the same bytes" || true
