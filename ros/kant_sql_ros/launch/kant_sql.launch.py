"""Starts the knowledge base as a lifecycle node, configured and active.

ros2 launch kant_sql_ros kant_sql.launch.py url:=sqlite:////var/lib/robot/knowledge.db
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.parameter_descriptions import ParameterValue
from lifecycle_msgs.msg import Transition

# Without a URL, the node takes what the environment variable KANT_SQL_URL has.
PARAMETERS = {"url": "", "knowledge_base": "default", "actor": "", "introspection": False}


def generate_launch_description() -> LaunchDescription:
    """Describe the node and its two transitions."""
    node = LifecycleNode(
        package="kant_sql_ros",
        executable="knowledge_base",
        name="kant_sql",
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[
            {
                name: ParameterValue(LaunchConfiguration(name), value_type=type(default))
                for name, default in PARAMETERS.items()
            }
        ],
    )

    def change(transition: int) -> EmitEvent:
        matcher = matches_action(node)
        return EmitEvent(
            event=ChangeState(lifecycle_node_matcher=matcher, transition_id=transition)
        )

    configured = OnStateTransition(
        target_lifecycle_node=node,
        start_state="configuring",
        goal_state="inactive",
        entities=[change(Transition.TRANSITION_ACTIVATE)],
    )
    arguments = [
        DeclareLaunchArgument(name, default_value=str(default))
        for name, default in {**PARAMETERS, "namespace": ""}.items()
    ]
    configure = change(Transition.TRANSITION_CONFIGURE)
    return LaunchDescription([*arguments, node, RegisterEventHandler(configured), configure])
