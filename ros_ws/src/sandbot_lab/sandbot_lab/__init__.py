"""The virtual lab: a time-domain ground truth that stands in for robot, bed and cameras.

world        the truth of a campaign: strength of the ground, effects, noise; read from a sealed file
week         what the trials of a campaign share: batches, drift, readings off their zero
effects      which effects there are, with their parameters
robot        leg set-points in, body motion out: `LabRobot` step by step, `simulate` at once
  kernel       the time step: who holds, who lets go, who swims
  stance       what a hold needs and how it carries the body
  ground       strength, surface, memory and force along the track
  outsiders    effects no catalogue knows
  physics      the flat records the compiled functions work on
  resistive    ground of another kind, with a kernel of its own in place of these five
bed          the fluidised bed, its blower and height sensor
penetrometer the force on one leg pressed into the ground
cameras      rendered frames (calibration: metres to pixels; drawing: discs and boxes; scenery: for people)
  film         what spoils film; spoiler: spoils it
direct       trials-table rows without video, for benchmarks
stage        one live trial; lab_node wires it to topics

Nothing here imports the models or the tracker: they are what it is there to test.
"""
