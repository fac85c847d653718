#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Types each way of installation of the README on a bare Debian and calibrates there.

    bench/bare_machine                   # all ways
    bench/bare_machine wheel deb         # these alone
    bench/bare_machine --suite trixie demo test      # the README's two commands, on Debian 13
    bench/bare_machine --ccache source   # with the compiler cache of this machine: for a second look, not for times

A bare Debian is debootstrap's smallest one (package `debootstrap`) in build/bare; each way has a copy of it, entered
with chroot in its own namespaces. Debian 12, unless `--suite` names another; the Dockerfile names its own. Needs root.
`wheel` and `deb` take what scripts/wheel and scripts/deb have made on this system, `sdist` what `python -m build
--sdist` makes of the tree, `source` a clone of the last commit; `demo` and `test` type scripts/demo and scripts/test in
one; `container` executes the Dockerfile's steps on such a clone, in place of a container engine. Prints the time until
everything is installed and the time of the first calibration, 13 images of a chessboard, by the program and from
Python. Exit status 1 when a way failed.
"""
import glob
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import ROOT

BARE = ROOT / "build/bare"
IMAGES = ROOT / "tests/data/frames/stereo_chess_opencv"
# How this machine reaches the network.
NETWORK = ["/etc/resolv.conf", "/etc/ssl/certs/ca-certificates.crt", "/etc/pip.conf", "/etc/npmrc", "/root/.npmrc"]
PYTHONS = {"bookworm": "cp311", "trixie": "cp313"}  # of the suites that are known
PROGRAM = "plenocal calibrate '/data/left*.jpg' --target chessboard:9x6:25mm -o /tmp/OUT && test -s /tmp/OUT/calibration.yaml"
PYTHON = """
import numpy
import plenocal
camera = plenocal.calibrate(images="/data/left*.jpg", target="chessboard:9x6:25mm")[0]
print(camera.project(numpy.array([[0.1, 0.0, 1.0]])))
"""


class Machine:
    """A copy of the bare Debian in which commands are run as root."""

    suite = "bookworm"

    def __init__(self, name, suite=None):
        base = BARE / f"base-{suite or self.suite}"
        if not (base / "complete").exists():
            shutil.rmtree(base, ignore_errors=True)
            base.mkdir(parents=True)
            run(["debootstrap", "--variant=minbase", "--include=ca-certificates", suite or self.suite, base,
                 "http://deb.debian.org/debian"], BARE / "debootstrap.log")
            (base / "complete").touch()
        self.root, self.log = BARE / name, BARE / f"{name}.log"
        self.log.unlink(missing_ok=True)
        shutil.rmtree(self.root, ignore_errors=True)
        run(["cp", "-a", base, self.root], self.log)
        for path in filter(os.path.exists, NETWORK):
            self.copy([path], path)
        self.copy(sorted(IMAGES.glob("left*.jpg")), "/data/")

    def copy(self, paths, place):
        """Files of this machine, to a folder (`/` at the end) or to a name."""
        target = self.root / str(place).lstrip("/")
        (target if str(place).endswith("/") else target.parent).mkdir(parents=True, exist_ok=True)
        run(["cp", "-a", "--dereference", *paths, target], self.log)

    def clone(self, place):
        """The last commit of this tree."""
        run(["git", "clone", "--quiet", ROOT, self.root / place.lstrip("/")], self.log)

    def run(self, script, folder="/", user="root", ccache=False):
        environment = {key: value for key, value in os.environ.items() if re.search("(?i)cert|ca_|_proxy$", key)}
        environment |= {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "LANG": "C.UTF-8",
                        "HOME": "/root" if user == "root" else f"/home/{user}", "DEBIAN_FRONTEND": "noninteractive"}
        mounts = "mount -t devpts -o newinstance,ptmxmode=0666 devpts $0/dev/pts && "
        if ccache:
            cache = subprocess.run(["ccache", "--get-config", "cache_dir"], capture_output=True, text=True, check=True)
            mounts += f"mkdir -p $0/ccache && mount --bind {shlex.quote(cache.stdout.strip())} $0/ccache && "
            environment["CCACHE_DIR"] = "/ccache"
        enter = mounts + 'exec chroot --userspec="$1" "$0" /bin/bash -euc "cd $2 && $3"'
        run(["unshare", "--mount", "--pid", "--fork", f"--mount-proc={self.root}/proc", "bash", "-euc", enter, self.root, user,
             folder, script], self.log, environment)


def run(command, log, environment=None):
    with open(log, "a") as out:
        subprocess.run([str(word) for word in command], env=environment, stdout=out, stderr=out, check=True)


def newest(pattern):
    found = sorted(glob.glob(str(ROOT / pattern)), key=os.path.getmtime)
    if not found:
        raise FileNotFoundError(f"no {pattern}: make it with scripts/{pattern.split('/')[1]}")
    return pathlib.Path(found[-1])


def install_wheel(options):
    machine, wheel = Machine("wheel"), newest(f"build/wheel/plenocal-*-{PYTHONS[Machine.suite]}-*.whl")
    machine.copy([wheel], "/tmp/")
    begin = time.monotonic()
    machine.run("apt-get update -qq && apt-get install -y -qq --no-install-recommends python3 python3-venv")
    machine.run(f"python3 -m venv /venv && /venv/bin/pip install --quiet /tmp/{wheel.name}")
    return machine, begin, "PATH=/venv/bin:$PATH"


def install_deb(options):
    machine = Machine("deb")
    machine.copy([newest(f"build/deb/{name}_*.deb") for name in ("plenocal", "python3-plenocal")], "/tmp/")
    begin = time.monotonic()
    machine.run("apt-get update -qq && apt-get install -y -qq --no-install-recommends /tmp/plenocal_*.deb /tmp/python3-plenocal_*.deb")
    return machine, begin, ""


def install_source(options):
    machine, folder = Machine("source"), str(ROOT)  # the compiler cache knows sources by their folder
    machine.clone(folder)
    begin = time.monotonic()
    machine.run("scripts/install_packages", folder)
    machine.run("cmake --workflow --preset release && cmake --install build/release", folder, ccache=options.ccache)
    return machine, begin, ""


def readme_command(name):
    def type_command(options):
        machine, folder = Machine(name), str(ROOT)
        machine.clone(folder)
        begin = time.monotonic()
        machine.run(f"scripts/{name}", folder, ccache=options.ccache)
        return machine, begin, f"PATH={folder}/build/release/apps:$PATH"

    return type_command


def install_sdist(options):
    machine = Machine("sdist")
    run([ROOT / "scripts/venv"], machine.log)
    shutil.rmtree(BARE / "dist", ignore_errors=True)
    run([ROOT / "build/venv/bin/python", "-m", "build", "--sdist", "--outdir", BARE / "dist", ROOT], machine.log)
    sdist = newest("build/bare/dist/*.tar.gz")
    machine.copy([sdist], "/tmp/")
    begin = time.monotonic()
    machine.run(f"tar xf {sdist.name} && {sdist.name.removesuffix('.tar.gz')}/scripts/install_packages python3-dev python3-venv",
                "/tmp")
    machine.run(f"python3 -m venv /venv && /venv/bin/pip install /tmp/{sdist.name}", ccache=options.ccache)
    return machine, begin, "PATH=/venv/bin:$PATH"


def install_container(options):
    """The Dockerfile's steps: a machine a stage, RUN in it, COPY from the tree or from the stage before."""
    text = re.sub(r"\\\n", " ", (ROOT / "Dockerfile").read_text())
    stages, machine, folder, user = {}, None, "/", "root"
    begin = time.monotonic()
    for line in filter(None, (line.strip() for line in text.splitlines())):
        word, _, rest = line.partition(" ")
        if word == "FROM":
            name = rest.partition(" AS ")[2] or "container"
            machine, folder, user = Machine(name, re.match(r"debian:(\w+)", rest)[1]), "/", "root"
            stages[name] = machine
        elif word == "WORKDIR":
            folder = rest
        elif word == "USER":
            user = rest
        elif word == "RUN":
            machine.run(rest, folder, user, ccache=options.ccache and len(stages) == 1)
        elif word == "COPY" and rest.startswith("--from="):
            stage, *paths = rest.removeprefix("--from=").split()
            files = [path for pattern in paths[:-1] for path in glob.glob(str(stages[stage].root) + pattern)]
            machine.copy(files, paths[-1])
        elif word == "COPY" and rest.split()[0] == ".":
            machine.clone(rest.split()[1])
        elif word not in ("#", "ENTRYPOINT", "CMD") and not word.startswith("#"):
            raise ValueError(f"Dockerfile: {word} is not executed here")
    return machine, begin, ""


WAYS = {"wheel": install_wheel, "deb": install_deb, "source": install_source, "sdist": install_sdist,
        "container": install_container, "demo": readme_command("demo"), "test": readme_command("test")}
WITHOUT_MODULE = {"source", "demo", "test"}  # Python does not find one by itself


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("ways", nargs="*", metavar="way", help=f"default: all of {', '.join(WAYS)}")
    parser.add_argument("--suite", choices=PYTHONS, default=Machine.suite, help="of Debian (default: %(default)s)")
    parser.add_argument("--ccache", action="store_true", help="compile with this machine's compiler cache")
    options = parser.parse_args()
    if unknown := set(options.ways) - set(WAYS):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; known: {', '.join(WAYS)}")
    Machine.suite = options.suite
    common.head("way", "installed after, s", "calibrated after, s", "disk, MB")
    failed = False
    for way in options.ways or WAYS:
        try:
            machine, begin, path = WAYS[way](options)
            installed = time.monotonic()
            user = "plenocal" if way == "container" else "root"
            machine.run(f"{path} bash -c {shlex.quote(PROGRAM)}", user=user)
            calibrated = time.monotonic()
            if way not in WITHOUT_MODULE:
                python = f"{path} python3 -c {shlex.quote(PYTHON)}"
                machine.run(python, user=user)
            size = sum(path.lstat().st_size for path in machine.root.rglob("*") if path.is_file() and not path.is_symlink())
            common.row(way, f"{installed - begin:.0f}", f"{calibrated - begin:.0f}", f"{size / 1e6:.0f}")
        except (subprocess.CalledProcessError, OSError, ValueError) as error:
            common.row(way, "failed", "", "")
            print(f"{way}: {error} (see {BARE}/*.log)", file=sys.stderr)
            failed = True
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
