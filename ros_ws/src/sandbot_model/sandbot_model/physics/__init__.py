"""The walking models and their effects: pure functions of depth, k, Δt and the effects' parameters."""
