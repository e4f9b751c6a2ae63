"""The console command ``swim-env``, a module for each subcommand; the scripts call the same.

A subcommand has ``add_arguments(parser)`` and ``main(options)``, which returns an exit code or
raises a `SwimError`. Its module's docstring is its help text.
"""
