"""Reference motions: the clip, its authoring by keyframes, its look-up."""
