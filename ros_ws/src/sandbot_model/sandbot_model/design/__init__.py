"""Which trials to run next, and when to stop: sequential design of experiments for telling models apart."""
