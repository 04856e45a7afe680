"""Labels of pixels, surfaces and objects: classes, scores, pictures, COCO."""
