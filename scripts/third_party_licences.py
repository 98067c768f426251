#!/usr/bin/env python3
"""Write docs/third_party.md: what the set-up brings along, and under which licences.

Read from the packages' own metadata where they are installed, so run it in a shell with ``source install/setup.bash``
after ``make setup`` and ``make bench``; ``--check`` only compares pinned packages with the page (exit status 1).
"""
import argparse
import re
import sys
import tempfile
from collections import defaultdict
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs/third_party.md'
#: files that pin packages, and what these are there for
PINS = {'pip': 'building', 'ros_prefix': 'prefix', 'bench': 'benches', 'floor_python310': 'tests on Python 3.10',
        'humble_apt': 'beside apt'}
#: where metadata does not say, or this Python does not need the package: by its page on PyPI
BY_PAGE = {'empy': 'LGPL', 'exceptiongroup': 'MIT', 'six': 'MIT', 'tomli': 'MIT', 'urdf-parser-py': 'BSD'}
#: what the packages of the suite import when they run
RUN_TIME = ('numpy', 'scipy', 'matplotlib', 'tqdm', 'rosbags', 'scikit-learn', 'pyyaml', 'dynamixel-sdk')
HEAD = """\
# Third-party licences

Made by `scripts/third_party_licences.py` from the metadata of the packages; a test compares it with what
`requirements/` pins. The suite itself is Apache-2.0 and contains none of this: the set-up downloads it. *Run time* are
the packages that nodes and the command `motion-style` import, with what these need; *prefix* what else stands in the
ROS 2 prefix (tools, tests); *beside apt* what is installed where ROS 2 Humble comes from apt. Nothing under the GPL is
imported by the suite: `dtw-python` is a peer that only `make bench` installs, `docutils` (one of its files is GPL) is a
tool of colcon, and the uncrustify package of the tree is a tool that is never called.

## Python packages

| package | version | licence | for |
| --- | --- | --- | --- |
"""
TREE = """
## ROS 2 packages of the prefix

They come out of the wheel `isaacsim-ros2` (PyPI), which NVIDIA publishes under the **NVIDIA Omniverse License
Agreement**; [setup.md](setup.md#the-licence-of-the-prefix) says what that means. By their own `package.xml`:

| licence | packages |
| --- | --- |
"""
DEBIAN = """
## Headers

Unpacked from packages of Debian 12, licences by their `copyright` files; headers of more rosidl packages come from the
wheels `ros-rosidl-typesupport-*` and `ros-rmw` of PyPI (Apache-2.0).

| package | licence |
| --- | --- |
"""


def pinned():
    """Every pinned Python package: dict of name to {file: version}."""
    found = defaultdict(dict)
    for name in PINS:
        text = ROOT.joinpath(f'requirements/{name}.txt').read_text()
        for package, version in re.findall(r'^([\w.-]+)==([^\s\\]+)', text, re.MULTILINE):
            found[package.lower()][name] = version
    return found


def licence(package):
    """A package's licence in its own words, short; None where it is not installed."""
    if package in BY_PAGE:
        return BY_PAGE[package]
    try:
        about = metadata.metadata(package)
    except metadata.PackageNotFoundError:
        return None
    named = [line.rpartition(' :: ')[2] for line in about.get_all('Classifier') or () if line.startswith('License ::')]
    words = about.get('License-Expression') or ', '.join(name for name in named if name != 'OSI Approved')
    words = words or (about.get('License') or '').strip().partition('\n')[0][:60]
    return words.replace('|', '/') or 'not said in its metadata'


def needed(packages):
    """The packages and everything they need when they run (without extras)."""
    found, todo = set(), list(packages)
    while todo:
        name = re.sub(r'[-_.]+', '-', todo.pop()).lower()
        if name in found:
            continue
        found.add(name)
        try:
            wanted = metadata.requires(name) or ()
        except metadata.PackageNotFoundError:
            continue
        todo += [re.match(r'[\w.-]+', line)[0] for line in wanted
                 if 'extra ==' not in line and 'python_version <' not in line]
    return found


def python_rows():
    """Rows of the first table."""
    at_run_time = needed(RUN_TIME)
    for package, versions in sorted(pinned().items()):
        words = licence(package)
        if words is None:
            words = 'not installed here; see its page on PyPI'
        uses = ['run time'] if package in at_run_time else []
        uses += [PINS[name] for name in versions if not (uses and name == 'ros_prefix')]
        numbers = ', '.join(dict.fromkeys(versions.values()))
        yield f'| {package} | {numbers} | {words} | {", ".join(uses)} |'


def tree_rows(prefix):
    """Rows of the second table."""
    found = defaultdict(list)
    for manifest in sorted(prefix.glob('share/*/package.xml')):
        root = ElementTree.parse(manifest).getroot()
        words = ', '.join(sorted({each.text.strip() for each in root.iter('license')}))
        found[words].append(root.findtext('name').strip())
    for words, packages in sorted(found.items(), key=lambda pair: -len(pair[1])):
        shown = ', '.join(packages[:12]) + (f' and {len(packages) - 12} more' if len(packages) > 12 else '')
        yield f'| {words} | {len(packages)}: {shown} |'


def debian_rows():
    """Rows of the third table."""
    sys.path.insert(0, str(ROOT / 'scripts'))
    from ros_prefix import debian
    from ros_prefix.downloads import fetch_debian_headers
    for path in fetch_debian_headers():
        with tempfile.TemporaryDirectory() as folder:
            debian.unpack(path, Path(folder))
            texts = [file.read_text(errors='replace') for file in Path(folder).glob('usr/share/doc/*/copyright')]
        words = sorted({word.strip() for text in texts for word in re.findall(r'^License: *(.+)$', text, re.MULTILINE)})
        yield f'| {path.stem} | {", ".join(words) or "see its copyright file"} |'


def missing():
    """Pinned packages and versions that the page does not name."""
    lines = PAGE.read_text().splitlines()
    rows = {cells[1].strip(): cells[2] for cells in (line.split('|') for line in lines if line.startswith('| '))
            if len(cells) > 4}
    return [f'{package} {version}' for package, versions in pinned().items() for version in versions.values()
            if version not in rows.get(package, '').replace(',', ' ').split()]


def main():
    """Write the page, or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--check', action='store_true', help='only compare')
    if parser.parse_args().check:
        if missing():
            sys.exit(f'{PAGE} lacks {", ".join(missing())}: run {Path(__file__).name}')
        return
    prefix = next(path for path in map(Path, sys.path) if path.joinpath('rclpy').is_dir()).parent
    PAGE.write_text(HEAD + '\n'.join(python_rows()) + '\n' + TREE + '\n'.join(tree_rows(prefix)) + '\n' + DEBIAN
                    + '\n'.join(debian_rows()) + '\n')


if __name__ == '__main__':
    main()
