"""The pixel: its model, its effects, and the engines that make events of them."""
