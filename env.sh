# Source this file: the venv, the workspace overlay, and ROS kept on this host.
_trackway="$(cd "$(dirname "${BASH_SOURCE[0]:-$0}")" && pwd)"
if [ ! -f "$_trackway/.venv/bin/activate" ]; then
    echo "env.sh: no .venv here yet; run 'make setup' in $_trackway first" >&2
    return 2 2>/dev/null || exit 2
fi
source "$_trackway/.venv/bin/activate"

# The wheels' libraries are found here, so their start-up hook need not run the interpreter twice.
_libs="$VIRTUAL_ENV/lib"
for _dir in "$VIRTUAL_ENV"/lib/python3.*/site-packages/ros_*.libs; do
    [ -d "$_dir" ] && _libs="$_libs:$_dir"
done
export LD_LIBRARY_PATH="$_libs${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1

# The message definitions lie in the venv's own share/, the packages in the overlay.
export AMENT_PREFIX_PATH="$VIRTUAL_ENV${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}"
if [ -f "$_trackway/ros_ws/install/local_setup.bash" ]; then
    source "$_trackway/ros_ws/install/local_setup.bash"
fi

# Tools such as rosdep ask which ROS this is.
export ROS_DISTRO="${ROS_DISTRO:-jazzy}" ROS_VERSION=2 ROS_PYTHON_VERSION=3

# Matrices here are small and fits run in several processes: threads of the linear algebra only wait for one another.
export OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"

# Legs that move must not listen to a stranger's network: set this to SUBNET to leave the host.
export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
if [ -t 1 ]; then
    echo "trackway: ROS 2 discovery range is $ROS_AUTOMATIC_DISCOVERY_RANGE (export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET to leave this host)"
fi
unset _trackway _libs _dir
