r"""The zero of a wheel force transducer: determined from a lifted wheel, taken off every sample of a run.

Whatever the axes, a signal of a lifted wheel reads

.. math:: y = a + b \cos\psi + c \sin\psi .

In axes that turn with the wheel a is the zero of the bridges, and (b, c) is the outboard weight m_o g, which turns in
them: F_x' = m_o g sin(psi), F_z' = -m_o g cos(psi). In vehicle axes it is the other way round: a holds the weight
(F_z = -m_o g, unless it was tared away), and (b, c) is the zero of the bridges, which turns:
F_x: (o_x', o_z'), F_z: (o_z', -o_x'). What static unbalance pulls outward
(m e omega^2) is constant in wheel axes and turns in vehicle axes, so that at one speed it is confounded with a bridge's
zero: spin slowly.

Taking a, b and c off leaves, in either axes, nothing for a lifted wheel and the load of the ground for one that stands.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
