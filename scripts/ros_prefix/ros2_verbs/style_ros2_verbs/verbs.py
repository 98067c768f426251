"""What the commands share: verbs below a command, and calls to other nodes."""
import contextlib
import time
from typing import ClassVar

import rclpy
from ros2cli.command import CommandExtension
from ros2cli.node.direct import DirectNode
from ros2cli.node.direct import add_arguments as add_direct_arguments

DISCOVERY_S = 5.0


class VerbCommand(CommandExtension):
    """A command whose verbs are the functions in ``VERBS``: name -> (function, add_arguments or None)."""

    VERBS: ClassVar = {}

    def add_arguments(self, parser, cli_name):
        """One sub-parser a verb; the help of a verb is its function's docstring."""
        self._parser = parser
        verbs = parser.add_subparsers(title='Verbs', metavar='VERB')
        for name, (function, arguments) in self.VERBS.items():
            verb = verbs.add_parser(name, help=function.__doc__.splitlines()[0], description=function.__doc__)
            verb.set_defaults(_function=function)
            if arguments:
                arguments(verb)

    def main(self, *, parser, args):
        """Run the verb; without one, show the help."""
        if not hasattr(args, '_function'):
            self._parser.print_help()
            return 0
        return args._function(args)


def graph_arguments(parser):
    """Options of verbs that look at the running graph."""
    add_direct_arguments(parser)


@contextlib.contextmanager
def graph_node(args):
    """A node that has discovered the others: there are some, and the graph has not changed for a second."""
    with DirectNode(args) as direct:
        node, seen, still = direct.node, None, 0
        for _ in range(int(DISCOVERY_S / 0.25)):
            graph = (node.get_topic_names_and_types(), node.get_service_names_and_types())
            still = still + 1 if graph == seen else 0
            if still >= 4 and len(node.get_node_names()) > 1:
                break
            seen = graph
            time.sleep(0.25)
        yield node


def call(node, service_type, service_name, request, timeout_s=DISCOVERY_S):
    """Response of a service, or None where it does not exist or answer in time."""
    client = node.create_client(service_type, service_name)
    try:
        if not client.wait_for_service(timeout_sec=timeout_s):
            return None
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=timeout_s)
        return future.result() if future.done() else None
    finally:
        node.destroy_client(client)
