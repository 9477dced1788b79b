"""What nodes share: conversion of messages, topics and QoS; lifecycle, parameters, status, main."""
