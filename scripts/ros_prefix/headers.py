"""C and C++ headers of message packages, made by the tree's own generators from the .idl files it carries.

Run as a module inside the prefix's environment: ``python headers.py TREE PACKAGE``.
"""
import importlib
import json
import re
import sys
import tempfile
from pathlib import Path

# messages that packages of this workspace, or a user's beside it, are built on
WANTED = ('std_msgs', 'sensor_msgs', 'trajectory_msgs', 'diagnostic_msgs', 'action_msgs')
GENERATORS = (
    ('rosidl_generator_c', 'generate_c'),
    ('rosidl_generator_cpp', 'generate_cpp'),
    ('rosidl_typesupport_introspection_c', 'generate_c'),
    ('rosidl_typesupport_introspection_cpp', 'generate_cpp'),
    ('rosidl_typesupport_fastrtps_c', 'generate_typesupport_fastrtps_c'),
    ('rosidl_typesupport_fastrtps_cpp', 'generate_cpp'),
)


def packages(tree):
    """WANTED and every message package they depend on."""
    share = Path(tree, 'share')
    found, todo = set(), list(WANTED)
    while todo:
        package = todo.pop()
        if package not in found and any(share.joinpath(package).glob('*/*.idl')):
            found.add(package)
            manifest = share.joinpath(package, 'package.xml').read_text()
            todo += re.findall(r'<(?:exec_|build_)?depend>(\w+)</', manifest)
    return sorted(found)


def parse_once():
    """Keep the generators from parsing a file again that another of them has parsed: most of their time."""
    import rosidl_cmake
    parse, known = rosidl_cmake.parse_idl_file, {}

    def parse_idl_file(locator):
        path = locator.get_absolute_path()
        if path not in known:
            known[path] = parse(locator)
        return known[path]

    rosidl_cmake.parse_idl_file = parse_idl_file


def generate(tree, package):
    """Write the headers of one package to ``TREE/include/PACKAGE/PACKAGE``."""
    parse_once()
    share = Path(tree, 'share')
    output = Path(tree, 'include', package, package)
    idl = sorted(path.relative_to(share / package) for path in share.joinpath(package).glob('*/*.idl'))
    for generator, function in GENERATORS:
        resource = share / generator / 'resource'
        with tempfile.TemporaryDirectory() as scratch:
            arguments = Path(scratch, 'arguments.json')
            arguments.write_text(json.dumps({
                'package_name': package, 'idl_tuples': [f'{share / package}:{path}' for path in idl],
                'output_dir': str(output), 'template_dir': str(resource), 'target_dependencies': [],
                'ros_interface_dependencies': []}))
            getattr(importlib.import_module(generator), function)(str(arguments))
        for template in resource.glob('*__visibility_control.h*.in'):
            text = template.read_text().replace('@PROJECT_NAME@', package)
            header = output / 'msg' / template.name[:-len('.in')]
            header.parent.mkdir(parents=True, exist_ok=True)
            header.write_text(text.replace('@PROJECT_NAME_UPPER@', package.upper()))
    for source in [*output.rglob('*.c'), *output.rglob('*.cpp')]:  # the tree has the libraries made of these
        source.unlink()


if __name__ == '__main__':
    generate(*sys.argv[1:])
