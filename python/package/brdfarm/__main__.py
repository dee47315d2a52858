"""`python -m brdfarm` is the command."""

from brdfarm._command import main

main()
