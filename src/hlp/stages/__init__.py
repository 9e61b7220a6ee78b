"""Run the method over a data set; each output is made once, on disk."""

STEPS = {
    "views": "RGB-D views of the models are rendered",
    "classifier": "a network learns to tell windows that show an object from others",
    "encoder": "a network learns features of local patches",
    "codebook": "local patches of the views are stored, with the poses that they vote for",
    "poses": "the objects are searched in the frames",
}
"""What each stage is for, in the order in which a run makes them."""
