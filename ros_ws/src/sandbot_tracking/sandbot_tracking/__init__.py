"""Camera frames to markers, metres and forward speed.

    import sandbot_tracking
    sandbot_tracking.track("dorsal.avi", "cameras.yaml", lateral="lateral.avi", omega_rad_s=12.0)

videos          track(): marker videos to landmarks, speed and observables
  offline       both cameras' frames to landmarks and speed, as live so in batch
  source        frames from a video file or a camera
  film_rate     frames per second: the calibration's, or the film's own
  marker_tracker  named markers followed from frame to frame
  markers       one frame to marker centres with covariance
    search      patches of a marker's size in a whole frame
    disc        one disc measured to the camera's noise; rim: what its edge looks like
    bed         the grains behind the markers, learnt as frames come
    bystanders  what stood there while the markers were seen, and so is none of them
  led           the sync LED in the frames
  pairing       frames of both cameras taken at the same instant
calibration     pixels to metres and back: Camera, read_cameras
lens            a camera from a chessboard and from points in space
live            the same frame by frame, as a trial runs
  pixels        image messages to grey pixels
  camera_clock  a camera's clock against the robot's; frame_times: period, jitter and frames lost
  latency       from exposure to speed
speed           positions to velocity now, without lag
smooth          positions to velocity afterwards
period          mean speed and lift of each turn of the legs, live
trial           landmarks and leg angles to a trial's observables
  fold          steps laid over one another; the steepest and the highest point; windows: compiled
tracker_node, camera_node   their wiring to ROS
tools/          calibrate, track_video
"""

from typing import TYPE_CHECKING

from sandbot_common.lazy import door

if TYPE_CHECKING:
    from sandbot_tracking.calibration import Camera, read_cameras
    from sandbot_tracking.videos import Track, track

__all__ = ("Camera", "Track", "read_cameras", "track")

_HOME = {"track": ".videos", "Track": ".videos", "Camera": ".calibration", "read_cameras": ".calibration"}
__getattr__, __dir__ = door(__name__, _HOME)
