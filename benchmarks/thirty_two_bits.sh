#!/usr/bin/env bash
# Does rotorfit say the same where integers have 32 bits?  sudo bash benchmarks/thirty_two_bits.sh
# Makes a Debian of that kind (400 MB, kept for the next time; needs debootstrap and its mirror), reads every
# log of the real data here and there, identifies one, and compares. PYTHON: one that has rotorfit.
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
root=${ROOT32:-/var/tmp/rotorfit-i386}
data=${ROTORFIT_DATA:-$here/../shared/data}
python=${PYTHON:-python3}

if [ ! -e "$root/usr/bin/python3" ]; then
  packages=python3-numpy,python3-scipy,python3-pydantic,python3-jinja2,python3-threadpoolctl
  debootstrap --variant=minbase --arch=i386 --include="$packages" trixie "$root"
fi
# Python alone, which Debian lacks: as it is installed here.
rm -rf "$root/rotorfit" && mkdir -p "$root/rotorfit" "$root/data"
cp -r "$here/src/rotorfit" "$here/benchmarks/platform_numbers.py" "$root/rotorfit/"
for name in jaxtyping wadler_lindig; do
  place=$("$python" -c "import $name, pathlib; print(pathlib.Path($name.__file__).parent)")
  cp -r "$place" "$root/rotorfit/"
  cp -r "$place"-*.dist-info "$root/rotorfit/"
done
cp -ru "$data/." "$root/data/"

export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
"$python" "$here/benchmarks/platform_numbers.py" "$data" -o "$root/there.json"
chroot "$root" env PYTHONPATH=/rotorfit python3 /rotorfit/platform_numbers.py /data -o /here.json --against /there.json
