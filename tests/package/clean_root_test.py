#!/usr/bin/env python3
"""Makes a .deb of a build, installs it into a Debian root that has nothing else, and runs it there.

    clean_root_test.py BUILD

The root is made by mmdebstrap from the network's mirror, of this system's release, and thrown away: some 400 MB. It
runs the program, and a consumer that was compiled here against what the .deb holds. Exit code 77 where there is no
mmdebstrap or this is no Debian.
"""

import pathlib
import platform
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
SCENES = HERE.parents[1] / "scenes"

# Camera rays, fields, their files (OpenVDB) and pictures read and written (OpenImageIO): what opens all modules.
SCRIPT = """\
set -e
cd /root
apt-get install -y -q --no-install-recommends ./fieldtrace.deb
fieldtrace --version
fieldtrace mesh knot -o knot.ply
fieldtrace bake knot.ply -o knot.vdb --full --directions 32 --plane 64
fieldtrace info knot.vdb
fieldtrace render scenes/rectangle_light_box.xml -o box.exr -o box.png --spp 1 --aov depth
fieldtrace compare box.exr box.exr --fail-above 0
./consumer field.vdb
if ldd /usr/bin/fieldtrace /usr/lib/libfieldtrace.so.* /usr/lib/fieldtrace/*.so | grep "not found"; then exit 1; fi
apt-get remove -y -q fieldtrace
if find /usr -name "*fieldtrace*" | grep .; then exit 1; fi
"""


def run(*command):
    result = subprocess.run([str(c) for c in command], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if result.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: {result.returncode}\n{result.stdout[-4000:]}")
    return result.stdout


def main():
    release = platform.freedesktop_os_release()
    if release.get("ID") != "debian" or not shutil.which("mmdebstrap"):
        print("skipped: needs Debian and mmdebstrap (tools/install_packages.sh --with-clean-root)")
        sys.exit(77)
    build = pathlib.Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        run("cpack", "--config", build / "CPackConfig.cmake", "-B", folder / "packages")
        (package,) = (folder / "packages").glob("*.deb")
        run("dpkg-deb", "-x", package, folder / "unpacked")
        usr = folder / "unpacked/usr"
        run("cc", "-std=c99", HERE / "consumer_c/main.c", "-o", folder / "consumer", f"-I{usr}/include", f"-L{usr}/lib",
            "-lfieldtrace")
        shutil.copy(package, folder / "fieldtrace.deb")
        (folder / "script").write_text(SCRIPT)
        hooks = [f"copy-in {folder}/{name} /root" for name in ("fieldtrace.deb", "script", "consumer")]
        hooks += [f"copy-in {SCENES} /root", 'chroot "$1" sh /root/script']
        print(run("mmdebstrap", "--variant=minbase", "--format=null", *[f"--customize-hook={hook}" for hook in hooks],
                  release["VERSION_CODENAME"], "/dev/null")[-2000:])
        print("clean root: all is well")


if __name__ == "__main__":
    main()
