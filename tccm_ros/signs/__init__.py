"""Door signs in pictures: saliency proposes regions, HOG and an SVM decide, OCR reads."""
