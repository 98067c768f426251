"""The suite's nodes as launch actions, shared by the launch files of this folder."""
from pathlib import Path

from launch.actions import EmitEvent, RegisterEventHandler
from launch.conditions import IfCondition
from launch.events import matches_action
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.parameter_descriptions import ParameterValue
from lifecycle_msgs.msg import Transition

__all__ = ['CONFIG', 'lifecycle', 'predictor']

# beside this folder, in the source tree as well as where both are installed
CONFIG = Path(__file__).resolve().parents[1] / 'config'


def lifecycle(node, autostart):
    """A lifecycle node with what configures and activates it where ``autostart`` is true."""
    def change(transition):
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))
    return [
        RegisterEventHandler(OnStateTransition(
            target_lifecycle_node=node, start_state='configuring', goal_state='inactive',
            entities=[change(Transition.TRANSITION_ACTIVATE)]), condition=IfCondition(autostart)),
        node,
        EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node),
                                    transition_id=Transition.TRANSITION_CONFIGURE), condition=IfCondition(autostart)),
    ]


def predictor(model, joint_map, params, joint_states='joint_states', namespace='', autostart='true', **more):
    """The predictor node; ``more`` are further parameters."""
    return lifecycle(LifecycleNode(
        package='style_predictor', executable='predictor', name='predictor', namespace=namespace, output='screen',
        parameters=[params, {'model': ParameterValue(model, value_type=str),
                             'joint_map': ParameterValue(joint_map, value_type=str), **more}],
        remappings=[('joint_states', joint_states)]), autostart)
