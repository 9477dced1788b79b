"""Shared by all nodes: conversion of messages, topics and QoS, lifecycle, parameters, status."""
