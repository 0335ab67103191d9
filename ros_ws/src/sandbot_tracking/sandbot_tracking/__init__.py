"""Camera frames to markers, metres and forward speed.

    import sandbot_tracking
    sandbot_tracking.track("dorsal.avi", "cameras.yaml", lateral="lateral.avi", omega_rad_s=12.0)

videos          track(): marker videos to landmarks, speed and observables
  offline       both cameras' frames to landmarks and speed, live and in batch
  source        frames from a video file or a camera
  film_rate     frames per second: the calibration's, or the film's own
  marker_tracker  named markers followed from frame to frame
  markers       one frame to marker centres with covariance
    search      patches of a marker's size in a whole frame
    disc        one disc measured to the camera's noise; rim: the intensity profile of its edge
    bed         the background of grains behind the markers, learnt from the frames
    distractors marker-like objects that were seen together with all markers, and so are not markers
  led           the sync LED in the frames
  pairing       frames of both cameras taken at the same instant
calibration     pixels to metres and back: Camera, read_cameras
lens            a camera from a chessboard and from points in space
live            the same frame by frame, while a trial runs
  pixels        image messages to grey pixels
  camera_clock  a camera's clock against the robot's; frame_times: period, jitter and frames lost
  camera_motion  whether a camera stays where it stood when the trial began
  latency       from exposure to speed
speed           velocity from positions in real time, without lag
smooth          velocity from positions afterwards
period          mean speed and lift of each turn of the legs, live
trial           a trial's observables from landmarks and leg angles
  fold          all steps on one phase axis
  folded_peak   the steepest and the highest point of the folded step; windows: compiled fits
nodes/          tracker_node and camera_node connect them to ROS
tools/          calibrate, track_video
"""

from typing import TYPE_CHECKING

from sandbot_common.lazy import attach

if TYPE_CHECKING:
    from sandbot_tracking.calibration import Camera, read_cameras
    from sandbot_tracking.videos import Track, track

__all__ = ("Camera", "Track", "read_cameras", "track")

_MODULES = {"track": ".videos", "Track": ".videos", "Camera": ".calibration", "read_cameras": ".calibration"}
__getattr__, __dir__ = attach(__name__, _MODULES)
