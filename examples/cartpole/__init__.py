"""Balance gymnasium's inverted pendulum using only events.

A camera rides on the cart and looks at the pole. Each packet of events corrects an estimate of the
pole's angle (tracker.py), an observer adds the angular rate, and state feedback drives the cart
(controller.py). environment.py builds the scene, draws starts and pushes the pole; `play` runs one
trial. Start there:

    from evs.examples.cartpole.environment import CartPoleLoop, CartPoleTrial, play

    print(play(CartPoleLoop(), CartPoleTrial(seed=1)))

Results: docs/explanation/demos.md.
"""

TRACKERS = {"events": 0}
"""name of a tracker -> frames per second; 0: events"""

SEEDS = 20
"""trials of a measurement"""
