"""The kinds of array the model works with."""

from sandbot_common.arrays import Bools, Floats

Array = Floats
Bool = Bools
