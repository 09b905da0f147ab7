"""Fixtures: a ROS domain for every test, waiting with a deadline, processes that always end."""

from contextlib import nullcontext
import gc
import os
import signal
import tempfile

from hypothesis import HealthCheck, Phase, settings
from own_processes import free_domain, Processes
import pytest
from support import DEADLINE, limited, wait_until

WAITING_FIXTURES = {'ros_domain', 'bus', 'vcan0', 'guest'}
# s, of a real-time test and of its fixtures: longer than its deadlines
LIMIT = 150.0

# the tested processes would inherit the signals that nohup and & of a shell ignore
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# before numpy is imported: on a busy machine two threads of a fit wait for each other
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
ROS_HOME = tempfile.TemporaryDirectory(
    prefix='facade_manipulator_', ignore_cleanup_errors=True
)
os.environ['ROS_HOME'] = ROS_HOME.name
os.environ.setdefault('ROS_LOG_DIR', f'{ROS_HOME.name}/log')

# A failure repeats, because the examples are the same in each run. To find its smallest example,
# up to five minutes, run the test with --hypothesis-profile=shrink.
settings.register_profile(
    'project',
    deadline=None,
    derandomize=True,
    max_examples=50,
    report_multiple_bugs=False,
    phases=[Phase.explicit, Phase.generate, Phase.target],
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
settings.register_profile('shrink', settings.get_profile('project'), phases=[*Phase])
settings.register_profile('quick', settings.get_profile('project'), max_examples=25)
settings.load_profile('project')


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    """End a real-time test, or one of its fixtures, that hangs."""
    has_a_limit = item.get_closest_marker('realtime') and not item.get_closest_marker(
        'long'
    )
    with limited(item.name, LIMIT) if has_a_limit else nullcontext():
        return (yield)


pytest_runtest_call = pytest_runtest_setup
pytest_runtest_teardown = pytest_runtest_setup


@pytest.fixture
def ros_domain(monkeypatch):
    """Reserve a ROS domain that no other test on this machine uses."""
    with free_domain() as domain:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
        yield domain


class RosSession:
    """Nodes with one executor; `until` spins the executor while a condition is false."""

    def __init__(self) -> None:
        from rclpy.executors import SingleThreadedExecutor

        self.executor = SingleThreadedExecutor()
        self._nodes = []

    def add(self, node):
        """Add a node to the executor; it is closed and destroyed when the test ends."""
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def node(self, name: str = 'tester', **kwargs):
        """Return a new node for the publishers, subscriptions and clients of the test."""
        import rclpy

        return self.add(rclpy.create_node(name, **kwargs))

    def until(self, condition, what: str, deadline: float = DEADLINE):
        """Spin until the condition is true; return its value."""
        return wait_until(
            condition, what, deadline, lambda: self.executor.spin_once(0.02)
        )

    def collect(self, node, message_type, topic: str, qos=10) -> list:
        """Return a list that grows with every message on the topic."""
        messages: list = []
        node.create_subscription(message_type, topic, messages.append, qos)
        return messages

    def call(
        self, node, service_type, name: str, request=None, deadline: float = DEADLINE
    ):
        """Call a service and return its response."""
        client = node.create_client(service_type, name)
        self.until(client.service_is_ready, f'service {name}', deadline)
        future = client.call_async(request or service_type.Request())
        self.until(future.done, f'the reply of {name}', deadline)
        node.destroy_client(client)
        return future.result()

    def close(self) -> None:
        """End every node."""
        for node in self._nodes:
            if hasattr(node, 'close'):
                node.close()
            node.destroy_node()
        self.executor.shutdown()


@pytest.fixture
def ros(ros_domain, monkeypatch):
    """Run nodes in this process, in a separate ROS domain, with diagnostics at 10 Hz."""
    import rclpy

    monkeypatch.setattr(
        'facade_manipulator.nodes.diagnostics.Diagnostics.DIAGNOSTICS_PERIOD', 0.1
    )
    rclpy.init(domain_id=ros_domain)
    try:  # the next test begins without a context after any failure
        session = RosSession()
        yield session
        session.close()
    finally:
        rclpy.try_shutdown()


@pytest.fixture
def start_process(ros_domain, tmp_path):
    """Start ``python -m MODULE ARGS…`` in a separate process group, ended after the test."""
    processes = Processes(tmp_path)
    yield processes.start
    processes.end()


def pytest_collection_modifyitems(items):
    """Mark the tests whose fixtures wait; other real-time tests have their own mark."""
    for item in items:
        needed = {*item.fixturenames}
        if 'vcan0' in needed:
            item.add_marker('vcan')
        if WAITING_FIXTURES & needed:
            item.add_marker('realtime')


def pytest_collection_finish():
    """Freeze the objects of imports and collection, which the garbage collector then skips."""
    gc.collect()
    gc.freeze()
    # A control loop or node that ends here would unfreeze them, and each collection would take 0.2
    # s or more.
    gc.unfreeze = lambda: None


def pytest_sessionfinish(session, exitstatus):
    """Return success for a part of `make test` without any test selected by -k."""
    if (
        exitstatus == pytest.ExitCode.NO_TESTS_COLLECTED
        and session.config.option.keyword
    ):
        session.exitstatus = pytest.ExitCode.OK
