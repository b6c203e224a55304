"""Compare measured data with a simulation: find its errors, the causes that explain them, and the improvement of the
prediction if the causes are added to the model.
"""
