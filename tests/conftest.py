import signal

# A run started in the background inherits an ignored Ctrl-C, and so would every process whose stopping is tested.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
