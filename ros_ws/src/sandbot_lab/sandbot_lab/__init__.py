"""The virtual lab: a time-domain ground truth in place of robot, bed and cameras.

world        the truth of a campaign: strength of the ground, effects, noise; read from a sealed file
week         what the trials of a campaign share: batches, drift, offsets and scale errors of readings
effects      the available effects, with their parameters
robot        leg set-points in, body motion out: `LabRobot` step by step, `simulate` at once
  kernel       the time step: holding, release, swimming
  stance       when the ground holds a leg, and how a held leg carries the body
  ground       strength, surface, memory and force along the track
  motors       motors that do not reach the commanded rate; off_catalogue: effects that the catalogue lacks
  physics      the flat records the compiled functions work on
  resistive    a different kind of ground, with its own kernel (resistive_kernel) in place of these five
  jit          compilation, and a fingerprint of what is compiled
bed          the fluidised bed, its blower and height sensor
penetrometer the force on one leg pressed into the ground
cameras      rendered frames (calibration: metres to pixels; drawing: discs and boxes; scenery: for human viewers)
  film         parameters of degraded images; degradation: applies them
direct       trials-table rows without video, for benchmarks
live_trial   one live trial; lab_node wires it to topics

Nothing here imports the models or the tracker, which the lab serves to test.
"""
