"""The commands of `octoplan`, a file each: a function whose parameters are the command's."""
