"""``ros2 lifecycle``: nodes, get, set, list."""
import sys
from typing import ClassVar

from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState

from style_ros2_verbs.verbs import VerbCommand, call, graph_arguments, graph_node

GET_STATE = 'lifecycle_msgs/srv/GetState'


def lifecycle_nodes(node):
    """Full names of the nodes that answer ``~/get_state``."""
    suffix = '/get_state'
    return sorted(name[:-len(suffix)] for name, types in node.get_service_names_and_types()
                  if name.endswith(suffix) and GET_STATE in types)


def full_name(name):
    """With the slash that may be left out."""
    return name if name.startswith('/') else '/' + name


def ask(node, service_type, name, service, request):
    """Answer of a lifecycle service of ``name``; says so where there is none."""
    answer = call(node, service_type, f'{full_name(name)}/{service}', request)
    if answer is None:
        print('Node not found', file=sys.stderr)
    return answer


def nodes(args):
    """Output the lifecycle nodes."""
    with graph_node(args) as node:
        found = lifecycle_nodes(node)
    print(len(found) if args.count_nodes else '\n'.join(found))


def nodes_arguments(parser):
    graph_arguments(parser)
    parser.add_argument('-c', '--count-nodes', action='store_true', help='only output how many there are')


def get(args):
    """Output the state of a lifecycle node, or of all."""
    failed = 0
    with graph_node(args) as node:
        for name in [args.node_name] if args.node_name else lifecycle_nodes(node):
            answer = ask(node, GetState, name, 'get_state', GetState.Request())
            if answer is None:
                failed = 1
                continue
            prefix = '' if args.node_name else f'{name}: '
            print(f'{prefix}{answer.current_state.label} [{answer.current_state.id}]')
    return failed


def get_arguments(parser):
    graph_arguments(parser)
    parser.add_argument('node_name', nargs='?', help='a node; without one, every lifecycle node')


def list_transitions(args):
    """Output the transitions that a lifecycle node can take now."""
    with graph_node(args) as node:
        service = 'get_transition_graph' if args.all else 'get_available_transitions'
        answer = ask(node, GetAvailableTransitions, args.node_name, service, GetAvailableTransitions.Request())
    if answer is None:
        return 1
    for item in answer.available_transitions:
        print(f'- {item.transition.label} [{item.transition.id}]')
        print(f'\tStart: {item.start_state.label}\n\tGoal: {item.goal_state.label}')
    return 0


def list_arguments(parser):
    graph_arguments(parser)
    parser.add_argument('node_name', help='a lifecycle node')
    parser.add_argument('-a', '--all', action='store_true', help='every transition there is')


def set_state(args):
    """Make a lifecycle node take a transition."""
    with graph_node(args) as node:
        answer = ask(node, GetAvailableTransitions, args.node_name, 'get_available_transitions',
                     GetAvailableTransitions.Request())
        if answer is None:
            return 1
        possible = [item.transition for item in answer.available_transitions]
        chosen = next((t for t in possible if args.transition in (t.label, str(t.id))), None)
        if chosen is None:
            names = ', '.join(f'{t.label} [{t.id}]' for t in possible)
            print(f"Unknown transition requested, available ones are: {names}", file=sys.stderr)
            return 1
        request = ChangeState.Request()
        request.transition.id = chosen.id
        request.transition.label = chosen.label
        answer = call(node, ChangeState, f'{full_name(args.node_name)}/change_state', request, timeout_s=60.0)
    if answer is None or not answer.success:
        print('Transitioning failed', file=sys.stderr)
        return 1
    print('Transitioning successful')
    return 0


def set_arguments(parser):
    graph_arguments(parser)
    parser.add_argument('node_name', help='a lifecycle node')
    parser.add_argument('transition', help='label or number of the transition: configure, activate, deactivate, '
                                           'cleanup, shutdown')


class LifecycleCommand(VerbCommand):
    """Various lifecycle related sub-commands."""

    VERBS: ClassVar = {'get': (get, get_arguments), 'list': (list_transitions, list_arguments),
             'nodes': (nodes, nodes_arguments), 'set': (set_state, set_arguments)}
