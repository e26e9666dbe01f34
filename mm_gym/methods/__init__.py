"""The methods: what each propagates, how, at what order, cost and error bound; one file each."""

from mm_gym.methods.base import Method as Method
from mm_gym.methods.cayley_hamilton.method import CAYLEY_HAMILTON as CAYLEY_HAMILTON
from mm_gym.methods.exponential_action.method import EXPONENTIAL_ACTION as EXPONENTIAL_ACTION
from mm_gym.methods.fixed_step.method import rk4_method as rk4_method
from mm_gym.methods.fixed_step.method import (
    semi_implicit_euler_method as semi_implicit_euler_method,
)
from mm_gym.methods.linear.massless import MASSLESS as MASSLESS
from mm_gym.methods.linear.method import LINEAR as LINEAR
from mm_gym.methods.switched.method import SWITCHED as SWITCHED
from mm_gym.methods.switched.method import SWITCHED_SERIES as SWITCHED_SERIES
from mm_gym.methods.taylor.method import taylor_method as taylor_method
