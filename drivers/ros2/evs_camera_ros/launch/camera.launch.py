"""Start the camera, configure it and activate it."""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.conditions import IfCondition
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.parameter_descriptions import ParameterValue
from lifecycle_msgs.msg import Transition

from launch import LaunchDescription


def generate_launch_description():
    """Describe the node and its first two transitions."""
    share = get_package_share_directory("evs_camera_ros")
    arguments = [
        DeclareLaunchArgument("scene", description="MJCF, MJB or URDF of the world"),
        DeclareLaunchArgument("name", default_value="event_camera"),
        DeclareLaunchArgument("namespace", default_value=""),
        DeclareLaunchArgument(
            "params_file",
            default_value=f"{share}/config/camera.yaml",
            description="all other parameters",
        ),
        DeclareLaunchArgument(
            "autostart",
            default_value="true",
            description="false: the node waits, unconfigured, for a lifecycle manager",
        ),
    ]
    node = LifecycleNode(
        package="evs_camera_ros",
        executable="camera",
        name=LaunchConfiguration("name"),
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration("params_file"),
            {"scene": ParameterValue(LaunchConfiguration("scene"), value_type=str)},
        ],
        output="screen",
    )
    autostart = IfCondition(LaunchConfiguration("autostart"))
    activate = RegisterEventHandler(
        OnStateTransition(
            target_lifecycle_node=node,
            # not after a deactivation, which leads to the same state
            start_state="configuring",
            goal_state="inactive",
            entities=[_change(node, Transition.TRANSITION_ACTIVATE)],
        ),
        condition=autostart,
    )
    configure = _change(node, Transition.TRANSITION_CONFIGURE, condition=autostart)
    return LaunchDescription([*arguments, node, activate, configure])


def _change(node, transition, **options):
    event = ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition)
    return EmitEvent(event=event, **options)
