"""Starts the knowledge base as a lifecycle node, configured and active.

ros2 launch kant_sql_ros kant_sql.launch.py url:=sqlite:////var/lib/robot/knowledge.db
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue

# Without a URL, the node takes what the environment variable KANT_SQL_URL has.
DEFAULTS = {
    **{"url": "", "knowledge_base": "default", "actor": ""},
    **{"autostart": True, "introspection": False},
}


def generate_launch_description() -> LaunchDescription:
    """Describe the node and its arguments."""
    given = {
        name: ParameterValue(LaunchConfiguration(name), value_type=type(default))
        for name, default in DEFAULTS.items()
    }
    node = LifecycleNode(
        package="kant_sql_ros",
        executable="knowledge_base",
        name="kant_sql",
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[given],
    )
    arguments = {**DEFAULTS, "namespace": ""}.items()
    declared = [DeclareLaunchArgument(name, default_value=str(value)) for name, value in arguments]
    return LaunchDescription([*declared, node])
