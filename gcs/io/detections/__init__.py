"""Tables of detections of other programs: columns, models, ground truth, sanity warnings."""
