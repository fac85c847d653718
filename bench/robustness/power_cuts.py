#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What is left when the power is cut: the old results or the new ones?

    bench/robustness/power_cuts.py --program build/release/apps/plenocal            # every prefix of the writes of five commands
    bench/robustness/power_cuts.py --program build/release/apps/plenocal try        # of `try` alone
    bench/robustness/power_cuts.py --program build/release/apps/plenocal --share 0.02   # of the states, chosen at random

The system calls that change files are recorded (strace) while a command replaces old results, and replayed to every prefix
into what a file system without any order may hold then: data is on the disk once its file was waited for (fsync), a name once
its folder was; everything later is there or not, each operation on its own (a move between folders is one). Of these states are
looked at: all later operations, none, names without data, each operation alone, all but each, and a few at random. In every
state a reader opens a result and must find all old or all new files (after the command's end: new ones), and the repeated
run must write the new ones. Exit status 1 when one does not. Installs strace.
"""
import hashlib
import itertools
import pathlib
import re
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from data import small_sessions
from data.small_sessions import results

OF_DESCRIPTORS = ["write", "writev", "pwrite64", "ftruncate", "fsync", "fdatasync"]
OF_PATHS = ["open", "openat", "creat", "rename", "renameat", "renameat2", "mkdir", "mkdirat", "unlink", "unlinkat", "rmdir"]
RANDOM_STATES = 4
SHOWN = 3  # failures of a command


class Inode:
    """A file, whose content is a list of changes, or a folder."""

    def __init__(self, content=None):
        self.content = content  # None: a folder


class Disk:
    """The files below `out` as operations on names and on data, in order, with the one that made each of them last."""

    def __init__(self, out):
        self.root, self.out = Inode(), out
        self.names = {}        # (folder's inode, name) -> inode, as the running system sees it
        self.operations = []   # of names: {(folder's inode, name): inode or None}; of data: (inode, content)
        self.pending = []      # indices of operations that may be lost
        self.folders_left = {}  # index of an operation of names -> folders still to be waited for

    def find(self, path):
        """Inode of a path; None where there is none or it is outside of `out`."""
        inode = self.root
        for part in self.parts(path):
            inode = self.names.get((inode, part))
            if inode is None:
                return None
        return inode

    def parts(self, path):
        return pathlib.Path(path).relative_to(self.out).parts

    def entry(self, path):
        path = pathlib.Path(path)
        return self.find(path.parent), path.name

    def change_names(self, changes):
        self.names.update(changes)
        self.pending.append(len(self.operations))
        self.folders_left[len(self.operations)] = {folder for folder, _ in changes}
        self.operations.append(changes)

    def change_data(self, inode, content):
        inode.content = content
        self.pending.append(len(self.operations))
        self.operations.append((inode, content))

    def sync(self, inode):
        """Nothing of a file, or no name in a folder, can be lost any more."""
        for index in list(self.pending):
            operation = self.operations[index]
            if isinstance(operation, tuple):
                done = operation[0] is inode
            else:
                self.folders_left[index].discard(inode)
                done = not self.folders_left[index]
            if done:
                self.pending.remove(index)

    def files(self, lost):
        """Path -> content when the operations `lost` are."""
        names, contents = {}, {}
        for index, operation in enumerate(self.operations):
            if isinstance(operation, dict):
                # Lost as a whole, or in those folders that were not waited for.
                names.update({entry: inode for entry, inode in operation.items()
                              if index not in lost or entry[0] not in self.folders_left[index]})
            elif index not in lost:
                contents[operation[0]] = operation[1]
        found = {}

        def walk(folder, path):
            for (parent, name), inode in names.items():
                if parent is not folder or inode is None:
                    continue
                if inode.content is None:
                    found[f"{path}{name}/"] = None
                    walk(inode, f"{path}{name}/")
                else:
                    found[path + name] = contents.get(inode, b"")
        walk(self.root, "")
        return found

    def possible_states(self, rng):
        """Sets of operations that may be lost together."""
        pending = frozenset(self.pending)
        data = frozenset(index for index in pending if isinstance(self.operations[index], tuple))
        single = [frozenset({index}) for index in sorted(pending)]
        some = [frozenset(index for index in sorted(pending) if rng.random() < 0.5) for _ in range(RANDOM_STATES)]
        return {frozenset(), pending, data, *single, *(pending - one for one in single), *some}


def lines_of(trace):
    """The calls of a trace, with those that another process interrupted put together at their end."""
    begun = {}
    for line in trace.read_text().splitlines():
        process, _, call = line.partition(" ")
        call = call.strip()
        if call.endswith("<unfinished ...>"):
            begun[process] = call.removesuffix("<unfinished ...>")
        elif match := re.match(r"<\.\.\. \w+ resumed>(.*)", call):
            yield begun.pop(process) + match[1]
        else:
            yield call


def bytes_of(hexadecimal):
    """Of "\\x2f\\x74"."""
    return bytes.fromhex(re.match(r"(\\x[0-9a-f]{2})*", hexadecimal)[0].replace("\\x", ""))


def replay(trace, disk):
    """Applies each call of the trace to `disk`, and gives control back after each that changed it or waited for it."""
    for line in lines_of(trace):
        match = re.match(r"(\w+)\((.*)\) += (-?\d+)", line)
        if not match or int(match[3]) < 0:
            continue
        call, arguments, result = match[1], match[2], int(match[3])
        strings = [bytes_of(quoted) for quoted in re.findall(r'"([^"]*)"', arguments)]
        described = re.match(r"\w+<([^>]*)>", arguments)  # the file or folder of a descriptor: 3</path>
        target = pathlib.Path(bytes_of(described[1]).decode()) if described else disk.cwd
        paths = [] if call in OF_DESCRIPTORS else [target / name.decode() for name in strings]
        if paths:
            target = paths[0]
        if not target.is_relative_to(disk.out) or ".cache" in target.parts:
            continue  # nothing depends on the cache
        if call in ("openat", "open", "creat"):
            if "O_CREAT" not in arguments and "O_TRUNC" not in arguments:
                continue
            inode = disk.find(target)
            if inode is None:
                disk.change_names({disk.entry(target): Inode(b"")})
            elif "O_TRUNC" in arguments and inode.content:
                disk.change_data(inode, b"")
            else:
                continue
        elif call in ("write", "writev"):
            inode = disk.find(target)
            disk.change_data(inode, inode.content + b"".join(strings)[:result])
        elif call in ("fsync", "fdatasync"):
            disk.sync(disk.find(target))
        elif call.startswith("rename"):
            disk.change_names({disk.entry(paths[1]): disk.find(paths[0]), disk.entry(paths[0]): None})
        elif call.startswith("mkdir"):
            disk.change_names({disk.entry(target): Inode()})
        elif call in ("unlink", "unlinkat", "rmdir"):
            disk.change_names({disk.entry(target): None})
        else:
            sys.exit(f"{call}: is not replayed")  # no command makes such a call yet
        yield


class Command(small_sessions.Command):
    def __init__(self, program, folder, name):
        super().__init__(program, folder, name, "--threads", "1")

    def record(self):
        """The trace of a run that replaces the old results, and the disk before it."""
        self.write(self.old)
        trace = self.folder / "trace"
        common.run("strace", "-f", "-y", "-xx", "-s", "1000000000", "-e", f"trace={','.join(OF_DESCRIPTORS + OF_PATHS)}", "-o", trace,
                   *self.words, cwd=self.folder)
        disk = Disk(self.out)
        disk.cwd = self.folder
        for path, content in self.old.items():
            for parent in reversed(pathlib.Path(path).parents[:-1]):
                if disk.find(self.out / parent) is None:
                    disk.change_names({disk.entry(self.out / parent): Inode()})
            disk.change_names({disk.entry(self.out / path): Inode(b"")})
            disk.change_data(disk.find(self.out / path), content)
        disk.pending = []
        return trace, disk

    def is_wrong(self, files, ended):
        """What is wrong with a state of the disk, as a reader and the next run find it; empty: nothing."""
        self.write(files)
        left = self.read()
        if left not in ([self.new] if ended else [self.old, self.new]):
            kinds = {path: "old" if content == self.old.get(path) else "new" if content == self.new.get(path) else "broken"
                     for path, content in left.items()}
            return f"mixed results: {kinds}; missing: {sorted(set(self.new) - set(left))}"
        self.run()
        return "" if results(self.out) == self.new else "the next run writes other results"


def test(command, rng, share):
    """Numbers of operations, of different states (a share of all), and of those that are wrong."""
    trace, disk = command.record()
    seen, states, failed, prefixes = set(), 0, 0, 0
    for ended in itertools.chain((False for _ in replay(trace, disk)), [True]):
        prefixes += 1
        for lost in sorted(disk.possible_states(rng), key=sorted):
            files = disk.files(lost)
            key = hashlib.sha256(repr((ended, sorted(files.items(), key=lambda item: item[0]))).encode()).digest()
            if key in seen:
                continue
            seen.add(key)
            if rng.random() >= share:
                continue
            states += 1
            if wrong := command.is_wrong(files, ended):
                failed += 1
                if failed > SHOWN:
                    continue
                named = [disk.operations[index] for index in sorted(lost)]
                names = [[name for _, name in operation] if isinstance(operation, dict) else "data" for operation in named]
                print(f"after {prefixes} operations{', at the end' if ended else ''}, without {names}: {wrong}", file=sys.stderr)
    return prefixes - 1, states, failed


def main():
    parser = small_sessions.parser(__doc__)
    parser.add_argument("--share", type=float, default=1, help="of the states that is looked at")
    options = small_sessions.parse(parser)
    subprocess.run([common.ROOT / "scripts/install_packages", "strace"], check=True)
    common.head("command", "operations", "states", "failed")
    small_sessions.test_commands(options, Command, lambda command, rng: test(command, rng, options.share))


if __name__ == "__main__":
    main()
