"""The kinds of sensors: conversion of their records to points in space."""
