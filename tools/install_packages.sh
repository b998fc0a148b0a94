#!/usr/bin/env bash
# Installs the Debian packages that Fieldtrace needs: only those that are missing, with sudo if need be.
#   --with-oidn   also puts Intel Open Image Denoise, for `render --denoise`, into build/oidn, from the package pyoidn for
#                 Python (200 MB); tools/build.sh and tools/test.sh find it there
#   --with-python also puts what the tests of the Python package need, Mitsuba among it, into build/python (400 MB)
#   --with-slurm  also installs Slurm (13 MB), for the test farm.slurm, which starts one of its own; Debian enables the
#                 services slurmctld, slurmd and munge
#   --with-clean-root  also installs mmdebstrap, for the test package.clean_root, which downloads a Debian of its own
set -euo pipefail
cd "$(dirname "$0")/.."

oidn=
python=
slurm=()
clean_root=()
for option in "$@"; do
  case $option in
    --with-oidn) oidn=build/oidn ;;
    --with-python) python=build/python ;;
    --with-slurm) slurm=("slurm-wlm") ;;
    --with-clean-root) clean_root=("mmdebstrap") ;;
    *) sed -n '2,8s/^# //p' "$0" >&2; exit 2 ;;
  esac
done

# Last, because these need python3-venv.
install_oidn() {
  [[ -n $oidn ]] || return 0
  if compgen -G "$oidn/lib/python3*/site-packages/pyoidn/oidn/lib/cmake" >/dev/null; then
    echo "install_packages: $oidn is there"
    return 0
  fi
  # Without what the Python module itself needs. A folder that is half filled goes.
  if ! { python3 -m venv "$oidn" && "$oidn/bin/pip" install -q --no-deps pyoidn==2.5.1.0; }; then
    rm -rf "$oidn"
    echo "install_packages: pyoidn could not be installed; --denoise needs Open Image Denoise 2 from elsewhere" >&2
    exit 1
  fi
}

install_python() {
  [[ -n $python ]] || return 0
  if ! { python3 -m venv "$python" && "$python/bin/pip" install -q --disable-pip-version-check \
           nanobind scikit-build-core numpy matplotlib mypy mitsuba; }; then
    echo "install_packages: the Python packages could not be installed; tests that need them are skipped" >&2
    exit 1
  fi
}

packages=(
  g++ cmake ninja-build pkg-config ccache
  libembree-dev libtbb-dev libglm-dev libfmt-dev libhwy-dev libpugixml-dev libtinyobjloader-dev
  libopenimageio-dev libopenexr-dev libpng-dev openimageio-tools     # Debian's CMake files of OpenImageIO want the tools
  libopenvdb-dev libboost-iostreams-dev libblosc-dev libxxhash-dev
  libcli11-dev nlohmann-json3-dev
  libgtest-dev libopenvdb-tools glmark2-data python3 python3-venv    # tests; the demo's bunny
  chromium                                                           # tests: pages as a browser shows them
  libbenchmark-dev clang-format clang-tidy                           # -DFIELDTRACE_BENCHMARKS=ON; changing the code
  "${slurm[@]}" "${clean_root[@]}"
)

[[ -z $python ]] || packages+=(python3-dev libllvm19)               # the Python package; Mitsuba's variants of LLVM

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  echo "install_packages: this system has no apt; install the equivalents of: ${packages[*]}" >&2
  exit 1
fi

missing=()
for package in "${packages[@]}"; do
  state=$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null || true)
  [[ $state == installed ]] || missing+=("$package")
done
if [[ ${#missing[@]} -eq 0 ]]; then
  echo "install_packages: everything is installed"
  install_oidn
  install_python
  exit 0
fi

as_root=()
if [[ $(id -u) -ne 0 ]]; then
  if ! command -v sudo >/dev/null; then
    echo "install_packages: needs root to install: ${missing[*]}" >&2
    echo "install_packages: run as root: apt-get install ${missing[*]}" >&2
    exit 1
  fi
  as_root=(sudo)
fi

echo "install_packages: installing ${missing[*]}"
# `env` carries the setting through sudo. Outdated package lists appear as failed downloads, hence the update.
if ! { "${as_root[@]}" apt-get update -q &&
       "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
         apt-get install -q -y --no-install-recommends "${missing[@]}"; }; then
  echo "install_packages: apt-get failed; install by hand: ${missing[*]}" >&2
  exit 1
fi
install_oidn
install_python
