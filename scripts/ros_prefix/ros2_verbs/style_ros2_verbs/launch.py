"""``ros2 launch``."""
import os
import signal

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from ros2cli.command import CommandExtension


class LaunchCommand(CommandExtension):
    """Run a launch file."""

    def add_arguments(self, parser, cli_name):
        """As the command of Humble takes them."""
        parser.add_argument('-n', '--noninteractive', action='store_true', help='run without a terminal')
        parser.add_argument('-d', '--debug', action='store_true', help='print debug messages of the launch system')
        parser.add_argument('-p', '--print', '--print-description', dest='show', action='store_true',
                            help='print what would be launched, and stop')
        parser.add_argument('-s', '--show-args', '--show-arguments', dest='show_args', action='store_true',
                            help='show the arguments that the launch file takes, and stop')
        parser.add_argument('package_or_file', metavar='package_name', help='a package, or the path of a launch file')
        parser.add_argument('launch_file', metavar='launch_file_name', nargs='?',
                            help="a launch file of the package; with a path before, the first of the file's arguments")
        parser.add_argument('launch_arguments', nargs='*', help="arguments, each as 'name:=value'")

    def main(self, *, parser, args):
        """Exit status of the launch service."""
        arguments = list(args.launch_arguments)
        if os.path.isfile(args.package_or_file):
            path = os.path.abspath(args.package_or_file)
            if args.launch_file is not None:
                arguments.insert(0, args.launch_file)
        else:
            if args.launch_file is None:
                raise RuntimeError(f"'{args.package_or_file}' is not a file, and no launch file of a package "
                                   'of that name is given')
            path = find_launch_file(args.package_or_file, args.launch_file)
        return launch(path, parse_arguments(arguments), args)


def find_launch_file(package, name):
    """Path of the launch file ``name`` anywhere in the package's share folder."""
    try:
        share = get_package_share_directory(package)
    except PackageNotFoundError:
        raise RuntimeError(f"Package '{package}' not found") from None
    found = [os.path.join(folder, name) for folder, _, files in os.walk(share, followlinks=True) if name in files]
    if not found:
        raise RuntimeError(f"file '{name}' was not found in the share directory of package '{package}' ({share})")
    if len(found) > 1:
        raise RuntimeError(f"file '{name}' is there more than once; give the path of one: {', '.join(found)}")
    return found[0]


def parse_arguments(words):
    """Pairs of ``name:=value`` words; a later one overrides an earlier one."""
    pairs = {}
    for word in words:
        name, found, value = word.partition(':=')
        if not found or not name:
            raise RuntimeError(f"malformed launch argument '{word}', expected format '<name>:=<value>'")
        pairs[name] = value
    return list(pairs.items())


def launch(path, arguments, args):
    """Show or run the launch file."""
    from launch import LaunchDescription, LaunchIntrospector, LaunchService
    from launch.actions import IncludeLaunchDescription
    from launch.launch_description_sources import (
        AnyLaunchDescriptionSource,
        get_launch_description_from_any_launch_file,
    )
    if args.show or args.show_args:
        description = get_launch_description_from_any_launch_file(path)
        if args.show:
            print(LaunchIntrospector().format_launch_description(description))
        else:
            show_arguments(description)
        return 0
    service = LaunchService(argv=[f'{name}:={value}' for name, value in arguments],
                            noninteractive=args.noninteractive, debug=args.debug)
    service.include_launch_description(LaunchDescription([
        IncludeLaunchDescription(AnyLaunchDescriptionSource(path), launch_arguments=arguments)]))
    # launch reads signals from a socket. Python's KeyboardInterrupt, which comes on top, would tear what its loop does
    # at that moment: the end of a process is lost, and the launch waits for it for ever
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, lambda *_: None)
    end_by_sigterm(service)
    return service.run()


def end_by_sigterm(service):
    """Have SIGTERM end what was launched.

    Nobody installs a handler for it, so it kills the launch alone, and with one launch cancels itself: both leave its
    processes behind. `shutdown` sends each of them SIGINT and waits for it.
    """
    from launch import launch_service

    class Manager(launch_service.AsyncSafeSignalManager):
        def handle(self, signum, handler):
            if signum == signal.SIGTERM:
                return super().handle(signum, lambda _: service.shutdown(force_sync=True))
            return super().handle(signum, handler)
    launch_service.AsyncSafeSignalManager = Manager
    signal.signal(signal.SIGTERM, lambda *_: None)      # so that it reaches the manager's socket


def show_arguments(description):
    """Names, meanings and defaults of the arguments of a launch description."""
    declared = description.get_launch_arguments()
    print("Arguments (pass arguments as '<name>:=<value>'):\n")
    for argument in declared:
        print(f"    '{argument.name}':")
        print(f'        {argument.description}')
        if argument.default_value is not None:
            default = ' + '.join(substitution.describe() for substitution in argument.default_value)
            print(f'        (default: {default})')
    if not declared:
        print('  No arguments.')
