"""scikit-learn: DBSCAN."""

from sides.job_types import Inputs, Timed

REQUIRES = ("scikit-learn==1.9.1",)


def dbscan(x: Inputs) -> Timed:
    from sklearn.cluster import DBSCAN

    estimator = DBSCAN(eps=1.0, min_samples=1, metric="chebyshev")
    return lambda: estimator.fit(x["points"]).labels_
