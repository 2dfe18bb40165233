"""Installs the node's executable and its launch file; the node itself is in kant_sql."""

from setuptools import setup

NAME = "kant_sql_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/kant_sql.launch.py"]),
    ],
    entry_points={"console_scripts": ["knowledge_base = kant_sql.ros.node:main"]},
)
