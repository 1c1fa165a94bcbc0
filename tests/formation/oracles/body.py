"""A quadcopter by Newton and Euler, in matrices: thrust along the body's z, drag along its axes, four feet on a floor.

Motors front right, rear left, front left, rear right; the first two turn so that they push the nose left. Takes a
profile for its numbers alone. Imports nothing of the product.
"""

from typing import Any

import numpy as np

from tests.formation.oracles.frames import G, axis_angle, rotation_matrix

SIDES = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, -1.0, 0.0]])
SPIN = np.array([1.0, 1.0, -1.0, -1.0])


def arms(body: Any) -> np.ndarray:
    """Where the motors are, and the feet: on a circle of half the wheelbase, at 45 degrees."""
    return 0.5 * body.wheelbase_m * np.cos(np.pi / 4.0) * SIDES


def ground_effect(height: float, radius: float, coefficient: float) -> float:
    """1 / (1 - k (R / 4 z)^2), rotors a radius above the feet, at most 1.3 (Cheeseman and Bennett 1955)."""
    z = max(height, 0.0) + radius
    return min(1.0 / max(1.0 - coefficient * (radius / (4.0 * z)) ** 2, 0.1), 1.3)


def turned(q: np.ndarray, rate: np.ndarray, dt: float) -> np.ndarray:
    """R exp([w dt]x)."""
    size = np.linalg.norm(rate)
    return rotation_matrix(q) @ axis_angle(rate / size, size * dt)


def floor(body: Any, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force in the lab, torque in the body: feet that sink 1 mm under the weight, damped, with Coulomb's friction."""
    r, depth = rotation_matrix(x[6:10]), 0.001
    force, torque = np.zeros(3), np.zeros(3)
    for foot in arms(body):
        place, speed = x[:3] + r @ foot, x[3:6] + r @ np.cross(x[10:13], foot)
        if place[2] >= 0.0:
            continue
        stiffness, damping = body.mass_kg * G / (4.0 * depth), 0.5 * body.mass_kg * np.sqrt(G / depth)
        normal = max(-stiffness * place[2] - damping * speed[2], 0.0)
        flat = np.array([speed[0], speed[1], 0.0])
        push = np.array([0.0, 0.0, normal]) - 0.6 * normal * flat / max(np.linalg.norm(flat), 0.03)
        force += push
        torque += np.cross(foot, r.T @ push)
    return force, torque


def moved(body: Any, x: np.ndarray, motor_target: np.ndarray, push: np.ndarray, dt: float) -> np.ndarray:
    """The state after a step: motors first, then speeds by the old state, then places by the new speeds."""
    motors = motor_target + (x[13:17] - motor_target) * np.exp(-dt / body.motor_lag_s)
    r, inertia, rate = rotation_matrix(x[6:10]), np.diag(body.inertia_kg_m2), x[10:13]
    gain = ground_effect(x[2], body.rotor_radius_m, body.ground_effect)
    drag = r @ np.diag(body.drag_n_s_m) @ r.T @ x[3:6]
    force = r @ [0.0, 0.0, motors.sum() * gain] - drag + body.mass_kg * (push - [0.0, 0.0, G])
    lift = np.column_stack([np.zeros((4, 2)), motors])
    torque = np.cross(arms(body), lift).sum(axis=0) - np.cross(rate, inertia @ rate)
    torque[2] += body.yaw_torque_m * SPIN @ motors
    grip, twist = floor(body, x) if x[2] < body.wheelbase_m else (np.zeros(3), np.zeros(3))
    velocity = x[3:6] + dt * (force + grip) / body.mass_kg
    rate = rate + dt * np.linalg.solve(inertia, torque + twist)
    r = turned(x[6:10], rate, dt)
    w = 0.5 * np.sqrt(1.0 + np.trace(r))
    q = np.array([w, *(np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / (4.0 * w))])
    return np.concatenate([x[:3] + dt * velocity, velocity, q, rate, motors])
