"""Starts the knowledge base as a lifecycle node, configured and active.

ros2 launch kant_sql_ros kant_sql.launch.py url:=sqlite:////var/lib/robot/knowledge.db
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState, matches_node_name
from lifecycle_msgs.msg import Transition


def generate_launch_description() -> LaunchDescription:
    """Describe the node and its two transitions."""
    arguments = {"url": "sqlite:///robot.db", "knowledge_base": "default", "actor": ""}
    node = LifecycleNode(
        package="kant_sql_ros",
        executable="knowledge_base",
        name="kant_sql",
        namespace="",
        output="screen",
        parameters=[{name: LaunchConfiguration(name) for name in arguments}],
    )

    def change(transition: int) -> EmitEvent:
        matcher = matches_node_name("/kant_sql")
        return EmitEvent(
            event=ChangeState(lifecycle_node_matcher=matcher, transition_id=transition)
        )

    configured = OnStateTransition(
        target_lifecycle_node=node,
        start_state="configuring",
        goal_state="inactive",
        entities=[change(Transition.TRANSITION_ACTIVATE)],
    )
    declared = [
        DeclareLaunchArgument(name, default_value=value) for name, value in arguments.items()
    ]
    configure = change(Transition.TRANSITION_CONFIGURE)
    return LaunchDescription([*declared, node, RegisterEventHandler(configured), configure])
