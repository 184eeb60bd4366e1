"""Settings files: conversion between YAML text and values, with located error messages."""
