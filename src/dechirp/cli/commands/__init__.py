"""Commands of `dechirp`: one file per command, whose first function is the command."""
