"""The leg clock signal: gait parameters to leg set-points."""
