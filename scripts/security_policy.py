#!/usr/bin/env python3
"""Write the policies of SROS2 for the nodes that run: ``security_policy.py > config/security/policies.xml``.

What ``ros2 security generate_policy`` does: every node that is seen gets an enclave ``/style/NAME`` with exactly the
topics and services it has. The launch process is ``/`` (what a process without ``--enclave`` is); ``/style/operator``
may do everything. Start all nodes first, without security, as docs/security.md shows.
"""
import argparse
import sys
import time
from xml.sax.saxutils import quoteattr

import rclpy

LAUNCH = 'launch_ros_'
HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<!-- made by scripts/security_policy.py from running nodes; scripts/security_keystore.py or sros2 make keys of it -->
<policy version="0.2.0">
<enclaves>
"""
#: for people and their tools: everything
OPERATOR = {'topics': {'publish': {'*'}, 'subscribe': {'*'}}, 'services': {'request': {'*'}, 'reply': {'*'}}}


def seen(node, name, namespace):
    """Topics and services of one node, by what it does with them."""
    def names(pairs):
        return {topic for topic, _ in pairs}
    return {
        'topics': {'publish': names(node.get_publisher_names_and_types_by_node(name, namespace)),
                   'subscribe': names(node.get_subscriber_names_and_types_by_node(name, namespace))},
        'services': {'reply': names(node.get_service_names_and_types_by_node(name, namespace)),
                     'request': names(node.get_client_names_and_types_by_node(name, namespace))},
    }


def profile(name, namespace, rights):
    """XML of one node's rights."""
    lines = [f'    <profile ns={quoteattr(namespace)} node={quoteattr(name)}>']
    for kind, single in (('topics', 'topic'), ('services', 'service')):
        for way, names in rights[kind].items():
            if names:
                lines += [f'      <{kind} {way}="ALLOW">',
                          *(f'        <{single}>{each}</{single}>' for each in sorted(names)), f'      </{kind}>']
    return '\n'.join([*lines, '    </profile>'])


def collect(node, seconds):
    """Rights by enclave, of every node seen within that time; a node's come one after another, so they add up."""
    found, end = {}, time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.5)
        for name, namespace in node.get_node_names_and_namespaces():
            if name.startswith(('_', node.get_name())):
                continue
            launch = name.startswith(LAUNCH)
            key = ('/', 'launch_ros', namespace) if launch else ('/style/' + name, name, namespace)
            try:
                rights = seen(node, name, namespace)
            except RuntimeError:  # it has just gone
                continue
            if launch:  # its own parameter services carry its process number
                reply = rights['services']['reply']
                rights['services']['reply'] = {each.replace(f'/{name}/', f'/{LAUNCH}*/') for each in reply}
            rights['topics']['subscribe'].add('/clock')  # asked for only while use_sim_time is set
            kept = found.setdefault(key, rights)
            for kind, ways in rights.items():
                for way, names in ways.items():
                    kept[kind][way] |= names
    return found


def main(argv=None):
    """Print the policy file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=8.0, help='how long to look (default: %(default)s)')
    args = parser.parse_args(argv)
    rclpy.init()
    node = rclpy.create_node('security_policy', start_parameter_services=False)
    found = collect(node, args.seconds)
    if not found:
        sys.exit('No node is seen: start them first, in the same domain')
    print(HEAD, end='')
    for (path, name, namespace), rights in [*sorted(found.items()), (('/style/operator', 'operator', '/'), OPERATOR)]:
        print(f'  <enclave path={quoteattr(path)}>\n   <profiles>')
        print(f'{profile(name, namespace, rights)}\n   </profiles>\n  </enclave>')
    print('</enclaves>\n</policy>')


if __name__ == '__main__':
    main()
