"""Still fusion: disparity of the video at the resolution of a still, with edges where the still has them."""
