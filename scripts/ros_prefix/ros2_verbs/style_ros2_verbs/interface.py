"""``ros2 interface``: show, list, package."""
import re
from pathlib import Path
from typing import ClassVar

from rosidl_runtime_py import get_interface_path, get_interfaces

from style_ros2_verbs.verbs import VerbCommand

FIELD = re.compile(r'^\s*(?P<type>[A-Za-z]\w*(?:/\w+){0,2})(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+')
BASIC = {'bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring',
         *(f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64))}


def definition(name, comments, indent=''):
    """Lines of an interface definition; below each field of a message type, the lines of that type."""
    package = name.split('/')[0]
    for line in Path(get_interface_path(name)).read_text().splitlines():
        if not comments:
            line = re.sub(r'\s*#.*', '', line)
            if not line:
                continue
        yield indent + line
        field = FIELD.match(line)
        if field and '=' not in line.split('#')[0] and field['type'] not in BASIC:
            parts = field['type'].split('/')
            yield from definition(f'{parts[0] if len(parts) > 1 else package}/msg/{parts[-1]}', False, indent + '\t')


def show(args):
    """Output the definition of an interface."""
    try:
        print('\n'.join(definition(args.type, not args.no_comments)))
    except (LookupError, ValueError):
        raise RuntimeError(f"Unknown interface '{args.type}'; 'ros2 interface list' lists them") from None


def show_arguments(parser):
    parser.add_argument('type', help="an interface, e.g. 'style_msgs/msg/StyleEstimate'")
    parser.add_argument('--no-comments', action='store_true', help='leave the comments out')


def output(packages):
    for package, names in sorted(packages.items()):
        for name in sorted(names):
            print(f'{package}/{name}')


def list_all(args):
    """Output every interface there is."""
    output(get_interfaces())


def package(args):
    """Output the interfaces of a package."""
    try:
        output(get_interfaces([args.package_name]))
    except LookupError as error:
        raise RuntimeError(str(error)) from None


def package_arguments(parser):
    parser.add_argument('package_name', help="a package, e.g. 'style_msgs'")


class InterfaceCommand(VerbCommand):
    """Show information about ROS interfaces."""

    VERBS: ClassVar = {'list': (list_all, None), 'package': (package, package_arguments),
                       'show': (show, show_arguments)}
