"""ROS 2: a node that answers KANT's and PlanSys2's services, and recordings of it as revisions."""
