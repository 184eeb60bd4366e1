"""mmwcore: maps, DBSCAN and decoding in compiled code."""

import numpy as np

from sides.job_types import Inputs, Timed

REQUIRES = ("mmwcore==0.8.0",)
PYTHON = "3.12"


def power_map(x: Inputs) -> Timed:
    from mmwcore.core import DopplerFFTSpec, RadarCube, RangeFFTSpec
    from mmwcore.dsp import doppler_fft, range_fft

    samples = x["samples"][None, :, None, :]
    over_range = RangeFFTSpec(n_fft=int(x["n_bins"]), window="hann")
    over_velocity = DopplerFFTSpec(window="hann")

    def power() -> np.ndarray:
        spectrum = doppler_fft(range_fft(RadarCube(samples), over_range), over_velocity).data
        return (spectrum.real**2 + spectrum.imag**2)[0, :, 0]

    return power


def dbscan(x: Inputs) -> Timed:
    """Build the clustering call; mmwcore returns only the cluster centres."""
    from mmwcore.core import DBSCANSpec, PointCloudFrame
    from mmwcore.dsp import cluster_point_cloud

    points = PointCloudFrame(x["points"].astype(np.float32))
    spec = DBSCANSpec(eps_m=1.0, min_samples=1, velocity_scale_s=0.0, use_z=True)
    return lambda: cluster_point_cloud(points, spec).centers


def decode(x: Inputs) -> Timed:
    from mmwcore.core import ADCComplexLayout, ADCFrameSpec
    from mmwcore.dsp import organize_adc_samples

    spec = ADCFrameSpec(*x["shape"].tolist(), layout=ADCComplexLayout.GROUP2_I_THEN_Q)
    return lambda: organize_adc_samples(x["codes"], spec).data[0]
