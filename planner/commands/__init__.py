"""The commands of `octoplan`, a file each."""
