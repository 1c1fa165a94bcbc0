"""An error-state Kalman filter of one body's motion, and the evidence of declared faults in its innovations."""
