"""``ros2 action``: list, info, send_goal."""
import math
import sys
import time
from typing import ClassVar

import rclpy
import yaml
from rclpy.action import (
    ActionClient,
    get_action_client_names_and_types_by_node,
    get_action_names_and_types,
    get_action_server_names_and_types_by_node,
)
from rclpy.signals import uninstall_signal_handlers
from rosidl_runtime_py import message_to_yaml, set_message_fields
from rosidl_runtime_py.utilities import get_action

from style_ros2_verbs.verbs import DISCOVERY_S, VerbCommand, graph_arguments, graph_node

STATUS = {4: 'SUCCEEDED', 5: 'CANCELED', 6: 'ABORTED'}


def list_actions(args):
    """Output the names of the actions."""
    with graph_node(args) as node:
        for name, types in sorted(get_action_names_and_types(node)):
            print(f'{name} [{", ".join(types)}]' if args.show_types else name)


def list_arguments(parser):
    graph_arguments(parser)
    parser.add_argument('-t', '--show-types', action='store_true', help='with the types')


def info(args):
    """Output the clients and servers of an action."""
    with graph_node(args) as node:
        sides = {'clients': get_action_client_names_and_types_by_node,
                 'servers': get_action_server_names_and_types_by_node}
        print(f'Action: {args.action_name}')
        for side, ask in sides.items():
            found = [f'{namespace.rstrip("/")}/{name}' for name, namespace in node.get_node_names_and_namespaces()
                     if args.action_name in dict(ask(node, name, namespace))]
            print(f'Action {side}: {len(found)}')
            for name in sorted(found):
                print(f'    {name}')


def info_arguments(parser):
    graph_arguments(parser)
    parser.add_argument('action_name', help="an action, e.g. '/synthesizer/synthesize'")


def read_goal(type_name, text):
    """Type and goal of an action; RuntimeError, which ros2 prints as one line, where they do not fit."""
    try:
        action = get_action(type_name)
    except (ValueError, AttributeError, ModuleNotFoundError):
        raise RuntimeError(f"'{type_name}' is not a known action type") from None
    try:
        values = yaml.safe_load(text) or {}
    except yaml.YAMLError as error:
        raise RuntimeError(f'The goal is not YAML: {error}') from None
    if not isinstance(values, dict):
        raise RuntimeError("The goal must be a mapping in YAML, e.g. '{duration: 5.0}'")
    goal = action.Goal()
    try:
        set_message_fields(goal, values)
    except (AttributeError, AssertionError, TypeError, ValueError) as error:
        raise RuntimeError(f'The goal does not fit {type_name}: {error}') from None
    return action, goal


def wait(node, future, timeout_s=math.inf):
    """Spin until the future is done or the time is up, in short steps, between which Ctrl-C is noticed."""
    end = time.monotonic() + timeout_s
    while not future.done() and time.monotonic() < end:
        rclpy.spin_until_future_complete(node, future, timeout_sec=0.2)


def send_goal(args):
    """Send a goal and wait for the result; Ctrl-C cancels it."""
    action, goal = read_goal(args.action_type, args.goal)
    with graph_node(args) as node:
        uninstall_signal_handlers()  # rclpy's would end the middleware at Ctrl-C, before the goal could be cancelled
        client = ActionClient(node, action, args.action_name)
        print('Waiting for an action server to become available...')
        if not client.wait_for_server(timeout_sec=args.wait or DISCOVERY_S):
            print(f'No action server {args.action_name}', file=sys.stderr)
            return 1
        print('Sending goal:\n     ' + message_to_yaml(goal).replace('\n', '\n     '))
        feedback = (lambda m: print('Feedback:\n    ' + message_to_yaml(m.feedback).replace('\n', '\n    '))) \
            if args.feedback else None
        accepting = client.send_goal_async(goal, feedback_callback=feedback)
        wait(node, accepting)
        handle = accepting.result()
        if not handle.accepted:
            print('Goal was rejected.', file=sys.stderr)
            return 1
        print(f'Goal accepted with ID: {bytes(handle.goal_id.uuid).hex()}\n')
        finishing = handle.get_result_async()
        try:
            wait(node, finishing)
        except KeyboardInterrupt:
            print('Cancelling...')
            wait(node, handle.cancel_goal_async(), DISCOVERY_S)
            wait(node, finishing, DISCOVERY_S)
        if not finishing.done():
            print('No result', file=sys.stderr)
            return 1
        answer = finishing.result()
        print('Result:\n    ' + message_to_yaml(answer.result).replace('\n', '\n    '))
        print(f'Goal finished with status: {STATUS.get(answer.status, answer.status)}')
        return 0 if answer.status == 4 else 1


def send_goal_arguments(parser):
    graph_arguments(parser)
    parser.add_argument('action_name', help="an action, e.g. '/synthesizer/synthesize'")
    parser.add_argument('action_type', help="its type, e.g. 'style_msgs/action/Synthesize'")
    parser.add_argument('goal', help="the goal as YAML, e.g. '{duration: 5.0}'")
    parser.add_argument('-f', '--feedback', action='store_true', help='output feedback')
    parser.add_argument('-w', '--wait', type=float, metavar='S', help='how long to wait for the server, s')


class ActionCommand(VerbCommand):
    """Various action related sub-commands."""

    VERBS: ClassVar = {'info': (info, info_arguments), 'list': (list_actions, list_arguments),
             'send_goal': (send_goal, send_goal_arguments)}
